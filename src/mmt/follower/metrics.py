"""The follower's metrics, on a port of their own; a follower serves nothing else."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from mmt.core.output.exposition import (
    counter,
    gauge,
    histogram,
    link_metrics,
    registry_of,
    session,
    tick_metrics,
)
from mmt.core.running.ticking import Ticker
from mmt.link.access import FOLLOWERS, Access
from mmt.link.client import FollowerClient
from mmt.link.serving.http import Listener, guarded_application, metrics_page

if TYPE_CHECKING:
    from prometheus_client.core import Metric


HOST: Final = "127.0.0.1"

Figures = Callable[[], tuple[str | None, Mapping[str, Any]]]
"""Returns the leader's name of the session, None before it is known, and the counts of the command
guard, empty if a recording is replayed."""


async def serve_metrics(
    client: FollowerClient, ticker: Ticker, figures: Figures, port: int, access: Access
) -> Listener:
    """Serve ``/metrics`` on this machine alone, with the link's token if it has one.

    Raises
    ------
    MmtError
        The port cannot be used.
    """
    access = Access(access.token)
    application = guarded_application(access)
    metrics_page(registry_of(lambda: _collect(client, ticker, *figures())))(application, access)
    entrance = replace(FOLLOWERS, address="follower_port of [metrics]")
    listener = Listener(application, entrance, busy=lambda: client.connected)
    await listener.start(HOST, port, access, allowed=False)
    return listener


def _collect(
    client: FollowerClient, ticker: Ticker, session_id: str | None, commands: Mapping[str, Any]
) -> Iterator["Metric"]:
    yield session(session_id, "follower")
    yield gauge("connected", "Whether the leader is connected.", client.connected)
    yield from link_metrics(client.statistics, client.endpoint.reader.latency)
    yield histogram("round_trip", "From a frame to the command that answers it.", client.round_trip)
    yield from tick_metrics(ticker)
    sent = client.frames.backfill.get("sent", 0)
    yield counter("backfilled_frames", "Frames that were sent again.", sent)
    if commands:
        yield counter("silences", "Times that the leader fell silent.", commands["silences"])
        yield counter("silent_seconds", "Time without a fresh command.", commands["silent_s"])
        yield counter("stale_commands", "Commands thrown away.", commands["stale_commands"])
        implausible = commands["implausible_commands"]
        yield counter("implausible_commands", "Commands with an impossible echo.", implausible)
