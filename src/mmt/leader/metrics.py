"""The leader's metrics for Prometheus, from figures that the leader counts anyway."""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from mmt.core.extras import require
from mmt.leader.part import Part, Session

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.link.serving.http import Page


class MetricsPart(Part):
    """Serve the metrics of every part beside the link.

    Parameters
    ----------
    session
        Session of the run.

    Raises
    ------
    InputError
        prometheus-client is not installed.
    """

    def __init__(self, session: Session) -> None:
        require("prometheus_client")
        self._session = session

    def pages(self) -> "list[Page]":
        """Return ``/metrics``."""
        from mmt.core.output.exposition import registry_of
        from mmt.link.serving.http import metrics_page

        return [metrics_page(registry_of(self.collect))]

    def collect(self) -> Iterator["Metric"]:
        """Yield the leader's metrics; called in a thread, about a millisecond."""
        from mmt.core.output.exposition import gauge, session, tick_metrics

        shared = self._session
        yield session(shared.log.session_id, "leader")
        yield gauge("session_time_seconds", "Session time.", shared.time_s())
        if shared.ticker is not None:
            yield from tick_metrics(shared.ticker)
        for part in shared.parts:
            yield from part.metrics()

    def metrics(self) -> "Iterable[Metric]":
        """Return the counts of the link."""
        from mmt.core.output.exposition import counter, gauge, link_metrics

        remote = self._session.remote
        if remote is None:
            return
        server, frames = remote.server, remote.backfill.missing.summary
        yield gauge("connected", "Whether a follower is connected.", server.connected)
        yield from link_metrics(server.statistics, server.endpoint.reader.latency)
        text = "Frames that were missing at their turn."
        yield counter("missing_frames", text, frames["missing"])
        yield counter("filled_frames", "Missing frames that were filled in.", frames["filled"])
        yield gauge("unfilled_frames", "Missing frames that were given up.", frames["lost"])
        yield gauge("awaited_frames", "Missing frames that may still come.", frames["waiting"])
