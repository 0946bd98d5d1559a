"""What both sides of the link share: callbacks, counts, and the messages of one side."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final, Literal, Protocol

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import MmtError
from mmt.core.ranges import Range
from mmt.core.ticking import TimeHistogram
from mmt.link.clock_offset import ClockJump
from mmt.link.protocol import MAX_RECORDS_PER_MESSAGE, FollowerHello, LinkStatistics, encode_event
from mmt.link.queue import SendQueue
from mmt.link.reader import BlockReader
from mmt.link.websocket import RateLimit
from mmt.scene import Scene

if TYPE_CHECKING:
    from mmt.link.emulation import EmulatedNetwork

LOG: Final = logging.getLogger("mmt.link")


def _nothing(*_: object) -> None:
    """Take note of nothing."""


def _no_ranges(_: int) -> list[Range]:
    """Miss nothing."""
    return []


def _log(error: Exception) -> None:
    LOG.error("an event of the link was not handled", exc_info=error)


@dataclass(frozen=True)
class LeaderEvents:
    """What the leader wants to be told; called on the loop, so they must return soon."""

    on_frames: Callable[[RecordArray, int], None]
    """Checked frames, shape (n,), read-only, in order; and their arrival, monotonic ns."""
    on_follower: Callable[[FollowerHello], None] = _nothing
    """A follower is about to be accepted; raising MmtError refuses it with that sentence."""
    on_end: Callable[[str], None] = _nothing
    """The follower ended the session, for this reason."""
    on_lost: Callable[[str], None] = _nothing
    """The follower went away without ending the session."""
    on_jump: Callable[[ClockJump], None] = _nothing
    """One of the two clocks has jumped against the other."""
    on_backfill: Callable[[RecordArray], None] = _nothing
    """Frames that were asked for, shape (n,), read-only, checked but for their numbers."""
    on_gone: Callable[[list[Range]], None] = _nothing
    """Frames that the follower has not got, or that cannot be used, by their numbers."""
    on_settle: Callable[[int], list[Range]] = _no_ranges
    """The follower is about to end and has sent the numbers below this one; return what is
    missing and is to be sent again."""
    on_error: Callable[[Exception], None] = _log
    """One of the above raised; by default the error is logged and the link goes on."""


@dataclass(frozen=True)
class FollowerEvents:
    """What the follower wants to be told; called on the loop, so they must return soon."""

    on_commands: Callable[[RecordArray, int], None]
    """Checked commands, shape (n,), read-only, newest last; and their arrival, monotonic ns."""
    on_session: Callable[[str], None] = _nothing
    """The leader's name of the session, which stands in its logs as well."""
    on_stop: Callable[[str], None] = _nothing
    """The leader asks to end the session, for this reason."""
    on_lost: Callable[[str], None] = _nothing
    """The link broke; it is taken up again as soon as the leader answers."""
    on_jump: Callable[[ClockJump], None] = _nothing
    """One of the two clocks has jumped against the other."""
    on_error: Callable[[Exception], None] = _log
    """One of the above raised; by default the error is logged and the link goes on."""


def call(
    function: Callable[..., None], *arguments: object, on_error: Callable[[Exception], None]
) -> None:
    """Call one of the events; python-socketio would but log what it raises."""
    try:
        function(*arguments)
    except Exception as error:  # noqa: BLE001 - handed to the service
        on_error(error)


class ExtraEvent:
    """One side of such an event: check what comes, encode what goes.

    Parameters
    ----------
    event
        Its name, the same on both sides.
    dtype
        Of its records, as `BlockReader` takes it.
    take
        Called with checked records, shape (n,), read-only, in order.
    began
        Called when a connection begins, perhaps to another that counts from its own start.
    """

    def __init__(
        self,
        event: str,
        dtype: np.dtype[np.void],
        take: Callable[[RecordArray], None],
        began: Callable[[], None],
    ) -> None:
        self.event = event
        self._dtype = dtype
        self._take = take
        self._began = began
        self._reader = BlockReader(dtype, f"{event} records")

    def restart(self) -> None:
        """Expect a new connection."""
        self._reader.restart()
        self._began()

    def read(self, arguments: tuple[object, ...], on_error: Callable[[Exception], None]) -> None:
        """Take the arguments of an event, as anybody may have sent them."""
        records = self._reader.read(arguments, time.monotonic_ns())
        if records is not None:
            call(self._take, records, on_error=on_error)

    def encode(self, records: RecordArray) -> bytes:
        """Return the message that carries records (n,), n at most 100.

        Raises
        ------
        ValueError
            They are of another dtype.
        """
        if records.dtype != self._dtype:
            message = f"{self.event} records are of dtype {records.dtype}: allowed is {self._dtype}"
            raise ValueError(message)
        return encode_event(self.event, records.tobytes())


class ForceFeedbackSide(Protocol):
    """One side of a method of force feedback, as far as its event goes."""

    @property
    def event(self) -> str | None:
        """The further event, None where frames are enough."""

    @property
    def dtype(self) -> "np.dtype[np.void] | None":
        """Of that event's records."""

    def take_records(self, records: RecordArray) -> None:
        """Take checked records (n,) of the further event."""

    def restart(self) -> None:
        """Expect a new connection."""


def emulated_network(
    scene: Scene, direction: Literal["up", "down"], say: Callable[[str], None]
) -> "EmulatedNetwork | None":
    """Return the network that the scene emulates on this side, None for none."""
    if scene.network is None:
        return None
    from mmt.link.emulation import EmulatedNetwork

    return EmulatedNetwork(scene.network, direction, scene.session.seed, say)


def extra_event(feedback: ForceFeedbackSide | None) -> "ExtraEvent | None":
    """Return the event of a method of force feedback, None where it has none."""
    if feedback is None or feedback.event is None or feedback.dtype is None:
        return None

    return ExtraEvent(feedback.event, feedback.dtype, feedback.take_records, feedback.restart)


class Endpoint:
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
        self.outbox = SendQueue(capacity) if network is None else network.outbox(capacity)
        self.gate = RateLimit(rate_hz, partial(reader.reject, "too fast"), on_shut)
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
