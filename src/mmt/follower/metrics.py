"""The follower's metrics, on a port of its own; a follower serves nothing else."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from mmt.core.exposition import (
    counter,
    gauge,
    histogram,
    link_metrics,
    registry_of,
    session,
    tick_metrics,
)
from mmt.link.access import Access
from mmt.link.http import Listener, guarded_application, metrics_page

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.follower.service import FollowerService

HOST: Final = "127.0.0.1"


async def serve_metrics(service: "FollowerService", port: int, access: Access) -> Listener:
    """Serve ``/metrics`` on this machine alone, with the link's token if it has one.

    Raises
    ------
    MmtError
        The port cannot be had.
    """
    access = Access(access.token)
    application = guarded_application(access)
    metrics_page(registry_of(lambda: _collect(service)))(application, access)
    listener = Listener(application, "follower_port of [metrics]")
    await listener.start(HOST, port, access, allowed=False)
    return listener


def _collect(service: "FollowerService") -> Iterator["Metric"]:
    client = service.client
    yield session(service.session_id, "follower")
    yield gauge("connected", "Whether the leader is connected.", client.connected)
    yield from link_metrics(client.statistics, client.latency)
    yield histogram("round_trip", "From a frame to the command that answers it.", client.round_trip)
    yield from tick_metrics(service.ticker.statistics, service.ticker.periods)
    sent = client.backfill.get("sent", 0)
    yield counter("backfilled_frames", "Frames that were sent again.", sent)
    guard = service.driven.guard
    if guard is not None:
        commands = guard.summary
        yield counter("silences", "Times that the leader fell silent.", commands["silences"])
        yield counter("silent_seconds", "Time without a fresh command.", commands["silent_s"])
        yield counter("stale_commands", "Commands thrown away.", commands["stale_commands"])
