"""Shared by both sides of the link: callbacks, counts, and the messages of one side."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from mmt.core.arrays import RecordArray
from mmt.core.errors import MmtError
from mmt.core.running.ticking import TimeHistogram
from mmt.core.sequence_numbers import Range
from mmt.link.clock_offset import ClockJump
from mmt.link.incoming import BlockReader, RateLimit
from mmt.link.protocol import (
    MAX_RECORDS_PER_MESSAGE,
    FollowerHello,
    LinkStatistics,
    encode_event,
)
from mmt.link.queue import SendQueue
from mmt.scene import Scene

if TYPE_CHECKING:
    from mmt.core.frames import FeedbackSide
    from mmt.link.emulated.network import EmulatedNetwork

LOG: Final = logging.getLogger("mmt.link")


def _nothing(*_: object) -> None:
    """Ignore the event."""


def _log(error: Exception) -> None:
    LOG.error("an event of the link was not handled", exc_info=error)


@dataclass(frozen=True)
class LeaderEvents:
    """The leader's callbacks, called on the event loop: they must return soon."""

    on_frames: Callable[[RecordArray, int], None]
    """Validated frames (n,), read-only, in order, and their arrival (monotonic, ns)."""
    on_follower: Callable[[FollowerHello], None] = _nothing
    """A follower is about to be accepted; raising MmtError refuses it with that message."""
    on_event: Callable[[str], None] = _nothing
    """The follower reports what has happened, in printable text of bounded length."""
    on_end: Callable[[str], None] = _nothing
    """The follower ended the session, with this reason."""
    on_lost: Callable[[str], None] = _nothing
    """The follower disconnected without ending the session."""
    on_jump: Callable[[ClockJump], None] = _nothing
    """One of the two clocks has jumped against the other."""
    on_backfill: Callable[[RecordArray], None] = _nothing
    """Back-filled frames (n,), read-only, validated except for their sequence numbers."""
    on_gone: Callable[[list[Range]], None] = _nothing
    """Ranges of frames that the follower no longer has, or that cannot be used."""
    on_settle: Callable[[int], list[Range]] = lambda _: []
    """The follower is about to end and has sent the numbers below this one; return the missing
    ranges that it is to send again."""
    on_error: Callable[[Exception], None] = _log
    """One of the above raised; by default the error is logged and the link goes on."""


@dataclass(frozen=True)
class FollowerEvents:
    """The follower's callbacks, called on the event loop: they must return soon."""

    on_commands: Callable[[RecordArray, int], None]
    """Validated commands (n,), read-only, newest last, and their arrival (monotonic, ns)."""
    on_open: Callable[[], None] = _nothing
    """A connection begins, the first one or after a break; nothing was sent over it yet."""
    on_session: Callable[[str], None] = _nothing
    """The leader's name of the session, which its logs contain as well."""
    on_stop: Callable[[str], None] = _nothing
    """The leader asks to end the session, with this reason."""
    on_lost: Callable[[str], None] = _nothing
    """The link broke; it is restored as soon as the leader answers."""
    on_jump: Callable[[ClockJump], None] = _nothing
    """One of the two clocks has jumped against the other."""
    on_error: Callable[[Exception], None] = _log
    """One of the above raised; by default the error is logged and the link goes on."""


def emulated_network(
    scene: Scene, direction: Literal["up", "down"], say: Callable[[str], None]
) -> "EmulatedNetwork | None":
    """Return the network that the scene emulates on this side, or None."""
    if scene.network is None:
        return None
    from mmt.link.emulated.network import EmulatedNetwork

    return EmulatedNetwork(scene.network, direction, scene.session.seed, say)


class Endpoint:
    """One side of the link over all its connections: reader, send queue, rate limit, counts.

    Parameters
    ----------
    reader
        Validates the received records.
    capacity
        Length of the send queue (messages).
    rate_hz
        Records a second that the session expects of the peer.
    events
        Callbacks of the service.
    on_exceeded
        Called with an error when the peer exceeds the rate limit and is cut off.
    network
        Network emulated on the way to the peer, or None.
    extra
        Side of force feedback with the scene's further event, or None.
    """

    def __init__(
        self,
        reader: BlockReader,
        capacity: int,
        rate_hz: float,
        events: LeaderEvents | FollowerEvents,
        on_exceeded: Callable[[MmtError], None],
        *,
        network: "EmulatedNetwork | None" = None,
        extra: "FeedbackSide | None" = None,
    ) -> None:
        self.reader = reader
        self.outbox = SendQueue(capacity) if network is None else network.send_queue(capacity)
        self.rate_limit = RateLimit(rate_hz, reader.reject, on_exceeded)
        self.extra_event = "" if extra is None else extra.event or ""
        """Name of the further event, empty for none."""
        self._extra: FeedbackSide | None = None
        if extra is not None and extra.dtype is not None:
            self._extra = extra
            self._extra_reader = BlockReader(extra.dtype, f"{extra.event} records")
        self._events = events

    def restart(self) -> None:
        """Prepare for a new connection; the peer may be a new process with numbers from 0."""
        self.reader.restart()
        if self._extra is not None:
            self._extra_reader.restart()
            self._extra.restart()

    def notify(self, function: Callable[..., None], *arguments: object) -> None:
        """Call one of the callbacks; `on_error` gets its exception, which the library would log."""
        try:
            function(*arguments)
        except Exception as error:  # noqa: BLE001 - handed to the service
            self._events.on_error(error)

    def notify_jump(self, jump: ClockJump) -> None:
        """Report that one of the clocks has jumped."""
        self.notify(self._events.on_jump, jump)

    def send_extra(self, records: RecordArray) -> None:
        """Queue records (n,) of the further event, which are not counted.

        Raises
        ------
        ValueError
            The records are of another dtype.
        """
        if self._extra is None:
            return
        event, dtype = self.extra_event, self._extra.dtype
        if records.dtype != dtype:
            message = f"{event} records are of dtype {records.dtype}: allowed is {dtype}"
            raise ValueError(message)
        for start in range(0, len(records), MAX_RECORDS_PER_MESSAGE):
            part = records[start : start + MAX_RECORDS_PER_MESSAGE]
            self.outbox.put(0, encode_event(event, part.tobytes()))

    def handle_extra(self, *arguments: object) -> None:
        """Handle a further event, whose arguments are not trusted."""
        if self._extra is not None:
            records = self._extra_reader.read(arguments, time.monotonic_ns())
            if records is not None:
                self.notify(self._extra.on_records, records)

    def statistics(
        self,
        *,
        frames: int,
        commands: int,
        clock: dict[str, float | None],
        round_trip: TimeHistogram | None = None,
    ) -> LinkStatistics:
        """Return the counts so far; takes a few hundred microseconds."""
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
            latency_max_ms=reader.latency.quantile_ms(1.0),
            round_trip_p50_ms=None if round_trip is None else round_trip.quantile_ms(0.5),
            round_trip_p99_ms=None if round_trip is None else round_trip.quantile_ms(0.99),
        )
