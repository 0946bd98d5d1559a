"""What either side of the link receives, bounds, counts and sends."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from mmt.core.arrays import RecordArray
from mmt.core.errors import MmtError
from mmt.core.ticking import TimeHistogram
from mmt.link.clock_offset import ClockJump
from mmt.link.events import FollowerEvents, LeaderEvents, call
from mmt.link.extra import ExtraEvent
from mmt.link.gate import Gate
from mmt.link.outbox import Outbox
from mmt.link.protocol import MAX_RECORDS_PER_MESSAGE, LinkStatistics, encode_event
from mmt.link.reading import BlockReader

if TYPE_CHECKING:
    from mmt.link.network import EmulatedNetwork


class Traffic:
    """The messages of one side, over all its connections.

    Parameters
    ----------
    reader
        Of the records that come.
    capacity
        Messages that may wait for a stalled link.
    rate_hz
        Records a second that the session expects of the other side.
    events
        Of the service that uses the link.
    on_shut
        Called with a fault when the other side sends far too much and is cut off.
    network
        Emulated between this side and the other.
    extra
        A further event of the scene.
    """

    def __init__(
        self,
        reader: BlockReader,
        capacity: int,
        rate_hz: float,
        events: LeaderEvents | FollowerEvents,
        on_shut: Callable[[MmtError], None],
        *,
        network: "EmulatedNetwork | None" = None,
        extra: ExtraEvent | None = None,
    ) -> None:
        self.reader = reader
        self.outbox = Outbox(capacity) if network is None else network.outbox(capacity)
        self.gate = Gate(rate_hz, partial(reader.reject, "too fast"), on_shut)
        self.extra = extra
        self._events = events

    def restart(self) -> None:
        """Expect a new connection."""
        self.reader.restart()
        if self.extra is not None:
            self.extra.restart()

    def tell(self, function: Callable[..., None], *arguments: object) -> None:
        """Call one of the events; what it raises is told as well."""
        call(function, *arguments, on_error=self._events.on_error)

    def tell_jump(self, jump: ClockJump) -> None:
        """Say that one of the clocks has jumped."""
        self.tell(self._events.on_jump, jump)

    def send(self, event: str, data: bytes, size: int) -> None:
        """Queue records of so many bytes each, in messages of at most 100."""
        for start in range(0, len(data), MAX_RECORDS_PER_MESSAGE * size):
            part = data[start : start + MAX_RECORDS_PER_MESSAGE * size]
            self.outbox.put(len(part) // size, encode_event(event, part))

    def send_extra(self, records: RecordArray) -> None:
        """Queue records (n,) of the further event, which are not counted."""
        if self.extra is not None:
            self.outbox.put(0, self.extra.encode(records))

    def take_extra(self, *arguments: object) -> None:
        """Take a further event, as anybody may have sent it."""
        if self.extra is not None:
            self.extra.read(arguments, self._events.on_error)

    def statistics(
        self,
        *,
        frames: int,
        commands: int,
        clock: dict[str, float | None],
        round_trip: TimeHistogram | None = None,
    ) -> LinkStatistics:
        """Return what was counted so far; a few hundred microseconds to compute."""
        reader, outbox = self.reader, self.outbox
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
