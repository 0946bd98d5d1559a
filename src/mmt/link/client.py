"""The follower's side of the link: it connects, streams, and comes back after a break."""

import asyncio
import struct
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Final

import socketio

from mmt.arrays import RecordArray
from mmt.errors import InputError, MmtError
from mmt.frames import COMMAND_DTYPE, frame_dtype
from mmt.link.access import Access, check_scheme
from mmt.link.backfilling import Backfiller
from mmt.link.clock_exchange import ClockAsker
from mmt.link.clock_offset import ClockJump
from mmt.link.counting import gather
from mmt.link.dialling import (
    ACKNOWLEDGE_S,
    ATTEMPT_S,
    CLOSE_TIMEOUT_S,
    Line,
    check_url,
    distrust,
    what_to_check,
)
from mmt.link.direct import client_send
from mmt.link.events import FollowerEvents, call
from mmt.link.extra import ExtraEvent
from mmt.link.gate import Gate
from mmt.link.keeping import KeptFrames
from mmt.link.log import LOG
from mmt.link.outbox import Outbox
from mmt.link.protocol import (
    CLOCK,
    COMMANDS,
    END,
    FRAMES,
    MAX_RECORDS_PER_MESSAGE,
    MAX_SENTENCE,
    MISSING,
    NETWORK,
    SETTLE,
    SETTLE_S,
    STOP,
    WELCOME,
    FollowerHello,
    LinkStatistics,
    encode_event,
    loss_of,
    printable,
    reason_of,
)
from mmt.link.reading import BlockReader
from mmt.ticking import TimeHistogram

if TYPE_CHECKING:
    from mmt.link.network import EmulatedNetwork

__all__ = ["FollowerClient", "FollowerEvents"]

_MESSAGES_WAITING: Final = 1000
"""Messages that wait for a stalled link where no frames are kept: nothing else saves them."""
_LIVE_MESSAGES_WAITING: Final = 50
"""Messages that wait where frames are kept: older ones would only delay what is live."""
_ECHO: Final = struct.Struct("<qq")
"""A command's ``echo_time_ns`` and ``echo_age_ns``; NumPy takes ten times as long to read them."""
_ECHO_FROM_END: Final = -28  # 40 bytes a command, of which the 12 before are number and time
_BETWEEN_ATTEMPTS_S: Final = 0.2
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
        self._extra = extra
        check_url(url)
        self._access = access or Access()
        check_scheme(url, self._access)
        self._tls = self._access.client_context()
        self._url = url
        self._hello = hello
        self._events = events
        self._dtype = frame_dtype(hello.channels)
        self._gathered = bytearray()
        self._last_frame = b""
        self._reader = BlockReader(COMMAND_DTYPE, "commands")
        self._network = network
        make_outbox = Outbox if network is None else network.outbox
        keeps = hello.keep_frames
        self._outbox = make_outbox(_LIVE_MESSAGES_WAITING if keeps else _MESSAGES_WAITING)
        self._kept = KeptFrames(self._dtype, keeps) if keeps else None
        self._backfiller: Backfiller | None = None
        if self._kept is not None:
            self._backfiller = Backfiller(self._kept, self._outbox)
        self._clock_hz = clock_hz
        self._clock = ClockAsker(self._reader, self._outbox, self._on_jump)
        self._round_trip = TimeHistogram()
        self._gate = Gate(hello.rate_hz, partial(self._reader.reject, "too fast"), self._on_shut)
        self._line: Line | None = None
        self._refusal: str | None = None
        self._connected = False
        self._ended = False
        self._told_to_stop = False

    @property
    def connected(self) -> bool:
        """Whether the link is up."""
        return self._connected

    @property
    def latency(self) -> TimeHistogram:
        """One-way latencies of the commands, where the clocks are known."""
        return self._reader.latency

    @property
    def round_trip(self) -> TimeHistogram:
        """Times from a frame to the command that echoes it."""
        return self._round_trip

    @property
    def statistics(self) -> LinkStatistics:
        """What was counted since the start; a few hundred microseconds to compute."""
        return gather(
            self._reader,
            self._outbox,
            frames=self._outbox.records,
            commands=self._reader.records,
            clock=self._clock.statistics,
            round_trip=self._round_trip,
        )

    @property
    def backfill(self) -> dict[str, int]:
        """Frames that are kept, were asked for, sent again, or not there; empty where none are."""
        if self._backfiller is None or self._kept is None:
            return {}
        asked, sent, gone = self._backfiller.asked, self._backfiller.sent, self._backfiller.gone
        return {"kept": len(self._kept), "asked": asked, "sent": sent, "gone": gone}

    async def connect(self, timeout_s: float) -> None:
        """Connect, waiting so long for a leader that is not there yet.

        Once connected, a link that breaks is taken up again until `disconnect`.

        Raises
        ------
        MmtError
            No leader answered in time, or it refused; the message says why.
        """
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        while True:
            problem = await self._attempt(min(ATTEMPT_S, max(timeout_s, 0.1)))
            if problem is None:
                return
            if self._refusal is not None:
                raise MmtError(f"the leader at {self._url} refused: {self._refusal}")
            if distrust(problem):
                raise MmtError(
                    f"the leader at {self._url} and this follower do not trust each other "
                    f"({problem}): check certificate, key and authority of [link] on both"
                )
            if loop.time() + _BETWEEN_ATTEMPTS_S > deadline_s:
                raise MmtError(
                    f"no leader answered at {self._url} within {timeout_s:g} s ({problem}): "
                    f"start mmt-leader there, and check {what_to_check(self._url)}"
                )
            await asyncio.sleep(_BETWEEN_ATTEMPTS_S)

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
        if frames.dtype != self._dtype:
            message = f"frames are of dtype {frames.dtype}: the hello's channels have {self._dtype}"
            raise ValueError(message)
        data = frames.tobytes()
        if self._kept is not None:
            self._kept.put(data)
        self._gathered += data
        if len(self._gathered) >= self._hello.frames_per_message * self._dtype.itemsize:
            self._send_gathered()

    def send_extra(self, records: RecordArray) -> None:
        """Queue records (n,) of the scene's further event for the leader; never waits."""
        if self._extra is not None:
            self._outbox.put(0, self._extra.encode(records))

    async def end(self, reason: str) -> None:
        """Send what waits, tell the leader that the session ends, and wait until it knows.

        Nothing happens where the link is not up, or the session has ended before.
        """
        if self._line is None or not self._connected or self._ended:
            return
        self._ended = True
        self._clock.stop()
        self._send_gathered()
        sent = struct.unpack_from("<I", self._last_frame)[0] + 1 if self._last_frame else 0
        if self._backfiller is not None:
            await self._settle(self._line, self._backfiller, sent)
        await self._outbox.finish(CLOSE_TIMEOUT_S)
        if not self.connected:
            return
        payload = {"reason": reason, "frames": sent}
        try:
            await self._line.client.call(END, payload, timeout=ACKNOWLEDGE_S)
        except socketio.exceptions.SocketIOError:
            LOG.warning("the leader did not acknowledge the end of the session")

    async def _settle(self, line: Line, backfiller: Backfiller, sent: int) -> None:
        """Send what the leader lacks of the frames so far."""
        await self._outbox.flush(CLOSE_TIMEOUT_S)
        try:
            answer = await line.client.call(SETTLE, {"frames": sent}, timeout=_SETTLED_S)
        except socketio.exceptions.SocketIOError:
            return  # it does not answer the end either, or knows of no such thing
        if isinstance(answer, Mapping):
            backfiller.want(answer.get("missing"))
            await backfiller.finish(SETTLE_S)

    async def disconnect(self) -> None:
        """Close the link for good; nothing happens where there is none."""
        self._ended = True
        self._close_outbox()
        line, self._line = self._line, None
        if line is not None:
            await line.close()
        self._connected = False
        self._clock.stop()

    # --- what python-socketio calls

    def _on_connect(self) -> None:
        self._connected = True
        self._reader.restart()
        if self._extra is not None:
            self._extra.restart()
        if self._line is not None:
            self._outbox.open(client_send(self._line.client))
            if self._backfiller is not None:
                self._backfiller.open()

    def _on_refused(self, problem: object = None) -> None:
        if isinstance(problem, Mapping) and "message" in problem:
            self._refusal = printable(str(problem["message"]), MAX_SENTENCE)
            LOG.warning("refused by the leader: %s", self._refusal)

    def _on_disconnect(self, reason: str) -> None:
        self._connected = False
        self._clock.stop()
        self._close_outbox()
        if self._line is not None and reason == self._line.client.reason.TRANSPORT_ERROR:
            self._line.drop()
        if not self._ended and not self._told_to_stop:
            call(self._events.on_lost, loss_of(reason), on_error=self._events.on_error)

    def _on_welcome(self, *arguments: object) -> None:
        payload = arguments[0] if len(arguments) == 1 else None
        if not isinstance(payload, Mapping):
            return
        self._clock.meet(payload.get("clock_id"))
        self._clock.start(self._clock_hz)
        session_id = payload.get("session_id")
        if isinstance(session_id, str) and session_id:
            call(self._events.on_session, printable(session_id), on_error=self._events.on_error)

    def _on_commands(self, *arguments: object) -> None:
        arrival_ns = time.monotonic_ns()
        block = self._reader.read(arguments, arrival_ns)
        if block is None:
            return
        echo_time_ns, echo_age_ns = _ECHO.unpack_from(block.data, block.nbytes + _ECHO_FROM_END)
        if echo_time_ns:
            self._round_trip.add(arrival_ns - echo_time_ns - echo_age_ns)
        call(self._events.on_commands, block, arrival_ns, on_error=self._events.on_error)

    def _on_extra(self, *arguments: object) -> None:
        if self._extra is not None:
            self._extra.read(arguments, self._events.on_error)

    def _on_stop(self, *arguments: object) -> None:
        reason = reason_of(arguments[0]) if len(arguments) == 1 else None
        self._told_to_stop = True
        call(self._events.on_stop, reason or "no reason given", on_error=self._events.on_error)

    def _on_missing(self, *arguments: object) -> None:
        if self._backfiller is not None:
            self._backfiller.want(arguments[0] if len(arguments) == 1 else None)

    def _on_network(self, *arguments: object) -> None:
        if self._network is not None:
            try:
                self._network.change(arguments[0] if len(arguments) == 1 else None)
            except InputError:
                self._reader.reject("malformed network")

    def _on_jump(self, jump: ClockJump) -> None:
        call(self._events.on_jump, jump, on_error=self._events.on_error)

    # --- the rest

    def _on_shut(self, fault: MmtError) -> None:
        self._ended = True  # there is nobody to come back to
        self._events.on_error(MmtError(f"the leader was cut off: {fault}"))

    async def _attempt(self, timeout_s: float) -> str | None:
        """Try once to connect; return what stood in the way."""
        self._refusal = None
        handlers: dict[str, Callable[..., None]] = {
            "connect": self._on_connect,
            "connect_error": self._on_refused,
            "disconnect": self._on_disconnect,
            WELCOME: self._on_welcome,
            STOP: self._on_stop,
            NETWORK: self._on_network,
            MISSING: self._on_missing,
        }
        frequent = {COMMANDS: self._on_commands, CLOCK: self._clock.take_answer}
        if self._extra is not None:
            frequent[self._extra.event] = self._on_extra
        self._line = line = Line.make(handlers, frequent, self._gate, self._tls)
        try:
            return await line.open(self._url, self._auth(), timeout_s)
        finally:
            if not self._connected:
                self._line = None
                await line.close()

    def _auth(self) -> dict[str, object]:
        token = self._access.token
        return self._hello.to_auth() | ({} if token is None else {"token": token})

    def _close_outbox(self) -> None:
        self._outbox.close()
        if self._backfiller is not None:
            self._backfiller.close()

    def _send_gathered(self) -> None:
        gathered, size = bytes(self._gathered), self._dtype.itemsize
        self._gathered.clear()
        for start in range(0, len(gathered), MAX_RECORDS_PER_MESSAGE * size):
            part = gathered[start : start + MAX_RECORDS_PER_MESSAGE * size]
            self._outbox.put(len(part) // size, encode_event(FRAMES, part))
            self._last_frame = part[-size:]
