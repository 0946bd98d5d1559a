"""The follower's side of the link: it connects, streams, and comes back after a break."""

import logging
import struct
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError, MmtError
from mmt.core.frames import COMMAND_DTYPE
from mmt.core.ticking import TimeHistogram
from mmt.link.access import Access
from mmt.link.clock_exchange import ClockRequester
from mmt.link.connection import ACKNOWLEDGE_S, CLOSE_TIMEOUT_S, Connection
from mmt.link.endpoint import Endpoint, ExtraEvent, FollowerEvents
from mmt.link.frame_sender import FrameSender
from mmt.link.protocol import (
    CLOCK,
    COMMANDS,
    END,
    MISSING,
    NETWORK,
    SETTLE,
    STOP,
    WELCOME,
    FollowerHello,
    LinkStatistics,
    argument_of,
    printable,
    reason_of,
)
from mmt.link.reader import BlockReader
from mmt.link.websocket import Send

if TYPE_CHECKING:
    from mmt.link.emulation import EmulatedNetwork

LOG: Final = logging.getLogger("mmt.link")


__all__ = ["FollowerClient", "FollowerEvents"]

_MESSAGES_WAITING: Final = 1000
"""Messages that wait for a stalled link where no frames are kept: nothing else saves them."""
_LIVE_MESSAGES_WAITING: Final = 50
"""Messages that wait where frames are kept: older ones would only delay what is live."""
_ECHO: Final = struct.Struct("<qq")
"""A command's ``echo_time_ns`` and ``echo_age_ns``; NumPy takes ten times as long to read them."""
_ECHO_FROM_END: Final = -28  # 40 bytes a command, of which the 12 before are number and time
_SETTLED_S: Final = 1.0
"""How long the leader may take to say what it lacks at the end."""


class FollowerClient:
    """Connect to a leader, stream frames to it and receive its commands.

    Parameters
    ----------
    url
        Of the leader: ``http://host:port``, or ``https``.
    hello
        What the follower says of itself; sent again with every connection.
    events
        What to call.
    network
        Emulated between this side and the leader.
    access
        The token and the certificates of this side.
    clock_hz
        How often time stamps are exchanged with the leader; 0 for never.
    extra
        A further event of the scene.

    Raises
    ------
    InputError
        `url` is none, or without TLS where there are certificates, or one of these cannot be
        used.
    """

    def __init__(
        self,
        url: str,
        hello: FollowerHello,
        events: FollowerEvents,
        *,
        network: "EmulatedNetwork | None" = None,
        access: Access | None = None,
        clock_hz: float = 0.0,
        extra: ExtraEvent | None = None,
    ) -> None:
        self._events = events
        self._network = network
        self._traffic = traffic = Endpoint(
            BlockReader(COMMAND_DTYPE, "commands"),
            _LIVE_MESSAGES_WAITING if hello.keep_frames else _MESSAGES_WAITING,
            hello.rate_hz,
            events,
            self._on_shut,
            network=network,
            extra=extra,
        )
        self._frames = FrameSender(hello, traffic)
        self._clock_hz = clock_hz
        self._clock = ClockRequester(traffic.reader, traffic.outbox, traffic.tell_jump)
        self._round_trip = TimeHistogram()
        self._connection = Connection(
            url,
            hello.to_auth(),
            access or Access(),
            traffic.gate,
            on_open=self._on_open,
            on_broken=self._on_broken,
        )
        self._ended = False
        self._told_to_stop = False

    @property
    def connected(self) -> bool:
        """Whether the link is up."""
        return self._connection.connected

    @property
    def latency(self) -> TimeHistogram:
        """One-way latencies of the commands, where the clocks are known."""
        return self._traffic.reader.latency

    @property
    def round_trip(self) -> TimeHistogram:
        """Times from a frame to the command that echoes it."""
        return self._round_trip

    @property
    def statistics(self) -> LinkStatistics:
        """What was counted since the start; a few hundred microseconds to compute."""
        traffic = self._traffic
        return traffic.statistics(
            frames=traffic.outbox.records,
            commands=traffic.reader.records,
            clock=self._clock.statistics,
            round_trip=self._round_trip,
        )

    @property
    def backfill(self) -> dict[str, int]:
        """Frames that are kept, were asked for, sent again, or not there; empty where none are."""
        return self._frames.backfill

    async def connect(self, timeout_s: float) -> None:
        """Connect, waiting so long for a leader that is not there yet.

        Once connected, a link that breaks is taken up again until `disconnect`.

        Raises
        ------
        MmtError
            No leader answered in time, or it refused; the message says why.
        """
        handlers = {
            WELCOME: self._on_welcome,
            STOP: self._on_stop,
            NETWORK: self._on_network,
            MISSING: self._on_missing,
        }
        frequent = {COMMANDS: self._on_commands, CLOCK: self._clock.take_answer}
        if self._traffic.extra is not None:
            frequent[self._traffic.extra.event] = self._traffic.take_extra
        await self._connection.open(handlers, frequent, timeout_s)

    def send_frames(self, frames: RecordArray) -> None:
        """Queue frames for the leader; never waits.

        They go out as soon as the hello's ``frames_per_message`` are gathered. When the link
        is down or stalled, the oldest are given up and counted.

        Parameters
        ----------
        frames
            Shape (n,), of the dtype of the hello's channels; their ``sequence`` must
            increase.

        Raises
        ------
        ValueError
            They are of another dtype.
        """
        self._frames.put(frames)

    def send_extra(self, records: RecordArray) -> None:
        """Queue records (n,) of the scene's further event for the leader; never waits."""
        self._traffic.send_extra(records)

    async def end(self, reason: str) -> None:
        """Send what waits, tell the leader that the session ends, and wait until it knows.

        Nothing happens where the link is not up, or the session has ended before.
        """
        if self._ended or not self._connection.connected:
            return
        self._ended = True
        self._clock.stop()
        self._frames.flush()
        if self._frames.keeps:
            await self._settle()
        await self._traffic.outbox.finish(CLOSE_TIMEOUT_S)
        if not self.connected:
            return
        payload = {"reason": reason, "frames": self._frames.sent}
        try:
            await self._connection.ask(END, payload, ACKNOWLEDGE_S)
        except ConnectionError:
            LOG.warning("the leader did not acknowledge the end of the session")

    async def disconnect(self) -> None:
        """Close the link for good; nothing happens where there is none."""
        self._ended = True
        self._fall_silent()
        await self._connection.close()

    # --- the connection

    def _on_open(self, send: Send) -> None:
        self._traffic.restart()
        self._traffic.outbox.open(send)
        self._frames.open()

    def _on_broken(self, reason: str) -> None:
        self._fall_silent()
        if not self._ended and not self._told_to_stop:
            self._traffic.tell(self._events.on_lost, reason)

    def _on_shut(self, fault: MmtError) -> None:
        self._ended = True  # there is nobody to come back to
        self._events.on_error(MmtError(f"the leader was cut off: {fault}"))

    def _fall_silent(self) -> None:
        self._clock.stop()
        self._traffic.outbox.close()
        self._frames.close()

    async def _settle(self) -> None:
        """Send what the leader lacks of the frames so far."""
        await self._traffic.outbox.flush(CLOSE_TIMEOUT_S)
        try:
            answer = await self._connection.ask(SETTLE, {"frames": self._frames.sent}, _SETTLED_S)
        except ConnectionError:
            return  # it does not answer the end either, or knows of no such thing
        if isinstance(answer, Mapping):
            await self._frames.settle(answer.get("missing"))

    # --- what the leader sends

    def _on_welcome(self, *arguments: object) -> None:
        payload = argument_of(arguments)
        if not isinstance(payload, Mapping):
            return
        self._clock.meet(payload.get("clock_id"))
        self._clock.start(self._clock_hz)
        session_id = payload.get("session_id")
        if isinstance(session_id, str) and session_id:
            self._traffic.tell(self._events.on_session, printable(session_id))

    def _on_commands(self, *arguments: object) -> None:
        arrival_ns = time.monotonic_ns()
        block = self._traffic.reader.read(arguments, arrival_ns)
        if block is None:
            return
        data = block.tobytes()  # the array's own buffer takes forty times as long to describe
        echo_time_ns, echo_age_ns = _ECHO.unpack_from(data, len(data) + _ECHO_FROM_END)
        if echo_time_ns:
            self._round_trip.add(arrival_ns - echo_time_ns - echo_age_ns)
        self._traffic.tell(self._events.on_commands, block, arrival_ns)

    def _on_stop(self, *arguments: object) -> None:
        self._told_to_stop = True
        reason = reason_of(argument_of(arguments))
        self._traffic.tell(self._events.on_stop, reason or "no reason given")

    def _on_missing(self, *arguments: object) -> None:
        self._frames.want(argument_of(arguments))

    def _on_network(self, *arguments: object) -> None:
        if self._network is not None:
            try:
                self._network.change(argument_of(arguments))
            except InputError:
                self._traffic.reader.reject("malformed network")
