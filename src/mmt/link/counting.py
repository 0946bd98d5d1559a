"""The counts of one side of the link, put together."""

from mmt.link.outbox import Outbox
from mmt.link.protocol import LinkStatistics
from mmt.link.reading import BlockReader
from mmt.ticking import TimeHistogram


def gather(
    reader: BlockReader,
    outbox: Outbox,
    *,
    frames: int,
    commands: int,
    clock: dict[str, float | None],
    round_trip: TimeHistogram | None = None,
) -> LinkStatistics:
    """Return what was counted so far; a few hundred microseconds to compute."""
    return LinkStatistics(
        frames=frames,
        commands=commands,
        messages_sent=outbox.messages,
        bytes_sent=outbox.bytes,
        dropped=outbox.dropped,
        messages_received=reader.messages,
        bytes_received=reader.bytes,
        lost=reader.lost,
        out_of_order=reader.out_of_order,
        repeated=reader.repeated,
        rejected=dict(reader.rejected),
        clock=clock,
        emulated=outbox.emulated,
        latency_p50_ms=reader.latency.quantile_ms(0.5),
        latency_p99_ms=reader.latency.quantile_ms(0.99),
        round_trip_p50_ms=None if round_trip is None else round_trip.quantile_ms(0.5),
        round_trip_p99_ms=None if round_trip is None else round_trip.quantile_ms(0.99),
    )
