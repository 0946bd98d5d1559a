"""The leader's side of the link: it listens, and serves one follower at a time."""

import asyncio
import math
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import socketio

from mmt.arrays import RecordArray
from mmt.errors import MmtError
from mmt.frames import COMMAND_DTYPE, Channel, frame_dtype, ordered_channels
from mmt.link.access import Access
from mmt.link.admission import admit
from mmt.link.clock import clock_id
from mmt.link.clock_exchange import ClockAnswerer
from mmt.link.clock_offset import ClockJump
from mmt.link.counting import gather
from mmt.link.direct import Send, ServerSockets
from mmt.link.events import LeaderEvents, call
from mmt.link.extra import ExtraEvent
from mmt.link.filling import BackfillPort
from mmt.link.gate import Gate
from mmt.link.listening import CLOSE_TIMEOUT_S, Listener, guarded_application, make_server
from mmt.link.log import LOG
from mmt.link.outbox import Outbox
from mmt.link.pages import Page
from mmt.link.protocol import (
    CLOCK,
    COMMANDS,
    END,
    FRAMES,
    MAX_RECORDS_PER_MESSAGE,
    MAX_SENTENCE,
    NETWORK,
    PING_TIMEOUT_S,
    PROTOCOL_VERSION,
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
from mmt.pacing import shortest_period_ns
from mmt.ranges import Range
from mmt.scene import Link
from mmt.ticking import TimeHistogram

if TYPE_CHECKING:
    from mmt.link.network import EmulatedNetwork

__all__ = ["LeaderEvents", "LeaderServer"]

_COMMANDS_WAIT_S: Final = 0.05
"""How long commands wait for a stalled link: older ones are of no use."""


@dataclass
class _Follower:
    sid: str
    hello: FollowerHello
    ended: bool = False


class LeaderServer:
    """Serve the link on Socket.IO (WebSocket alone, msgpack) to one follower at a time.

    Parameters
    ----------
    settings
        Where to listen; port 0 takes any free one.
    channels
        The channels that the leader's scene needs in each frame.
    events
        What to call.
    rate_hz
        Frames a second that the scene expects.
    fastest
        How many times faster than real time a follower may stream, as a replay can; what its
        numbers claim beyond that is not believed.
    network
        Emulated between this side and the follower; programs may change it over HTTP.
    session_id
        Names the session in what both sides log.
    pages
        What is served beside the link, for who has the token.
    extra
        A further event of the scene.

    Raises
    ------
    InputError
        The channels are none or unknown, or the token cannot be had.
    """

    def __init__(
        self,
        settings: Link,
        channels: Iterable[Channel],
        events: LeaderEvents,
        *,
        rate_hz: int = 1000,
        fastest: float = 100.0,
        network: "EmulatedNetwork | None" = None,
        session_id: str = "",
        pages: Iterable[Page] = (),
        extra: ExtraEvent | None = None,
    ) -> None:
        self._extra = extra
        self._settings = settings
        self._access = Access.of(settings)
        self._channels = ordered_channels(channels)
        self._events = events
        self._rate_hz = rate_hz
        self._reader = BlockReader(
            frame_dtype(self._channels), "frames", shortest_period_ns(rate_hz, fastest)
        )
        self._network = network
        self._session_id = session_id
        make_outbox = Outbox if network is None else network.outbox
        self._outbox = make_outbox(math.ceil(_COMMANDS_WAIT_S * rate_hz))
        self.clock = ClockAnswerer(self._reader, self._outbox, self._on_jump)
        self._follower: _Follower | None = None
        self._excess = ""
        self._gate = Gate(rate_hz, partial(self._reader.reject, "too fast"), self._on_shut)
        self._left = asyncio.Event()
        self._stopping = False
        self._greeting: asyncio.Task[None] | None = None
        self._dropping: asyncio.Task[None] | None = None
        self._server = make_server(PING_TIMEOUT_S)
        application = guarded_application(self._access)
        self._server.attach(application)
        if network is not None:
            network.serve(application, self._tell_network)
        for add_page in pages:
            add_page(application, self._access)
        self._listener = Listener(application)
        self._sockets = ServerSockets(self._server, application)
        self._server.on("connect", self._on_connect)
        self._server.on("disconnect", self._on_disconnect)
        self._server.on(END, self._on_end)
        self._frequent = {FRAMES: self._on_frames, CLOCK: self._on_clock}
        if extra is not None:
            self._frequent[extra.event] = self._on_extra
        for event, take in self._frequent.items():
            self._server.on(event, take)
        self._filling = BackfillPort(
            self._server,
            frame_dtype(self._channels),
            events,
            self._expects,
            self._reader,
        )

    @property
    def port(self) -> int:
        """The port that is listened on, 0 before `start`."""
        return self._listener.port

    @property
    def connected(self) -> bool:
        """Whether a follower is there that has not ended the session."""
        return self._follower is not None and not self._follower.ended

    @property
    def latency(self) -> TimeHistogram:
        """One-way latencies of the frames, where the clocks are known."""
        return self._reader.latency

    @property
    def statistics(self) -> LinkStatistics:
        """What was counted since the start; a few hundred microseconds to compute."""
        return gather(
            self._reader,
            self._outbox,
            frames=self._reader.records,
            commands=self._outbox.records,
            clock=self.clock.statistics,
        )

    async def start(self) -> None:
        """Listen.

        Raises
        ------
        InputError
            Strangers could connect and the scene does not allow it, or a certificate cannot
            be used.
        MmtError
            The host or the port cannot be had.
        """
        settings = self._settings
        await self._listener.start(
            settings.host, settings.port, self._access, allowed=settings.open
        )

    async def request_stop(self, reason: str) -> None:
        """Ask the follower to end, and wait a second at most until it has left."""
        if self._follower is None:
            return
        if not self._follower.ended:
            await self._server.emit(STOP, {"reason": reason}, to=self._follower.sid)
        for timeout_s in (CLOSE_TIMEOUT_S, SETTLE_S):
            with suppress(TimeoutError):
                await asyncio.wait_for(self._left.wait(), timeout_s)
            if self._left.is_set() or not self._filling.settling:
                break
        else:
            LOG.info("the follower did not leave in time")

    async def stop(self) -> None:
        """Drop the follower, if there is one, and stop listening."""
        self._stopping = True
        self._outbox.close()
        for task in (self._greeting, self._dropping):
            if task is not None:
                task.cancel()
        if not self._listener.port:
            return
        await self._sockets.close(CLOSE_TIMEOUT_S)
        await self._server.shutdown()
        await self._listener.stop()

    def send_commands(self, commands: RecordArray) -> None:
        """Queue motion commands for the follower; never waits.

        Nothing happens while there is no follower. When the link is stalled the oldest
        commands are given up and counted.

        Parameters
        ----------
        commands
            Shape (n,), of `mmt.frames.COMMAND_DTYPE`; their ``sequence`` must increase.

        Raises
        ------
        ValueError
            They are of another dtype.
        """
        if commands.dtype != COMMAND_DTYPE:
            message = f"commands are of dtype {commands.dtype}: allowed is COMMAND_DTYPE"
            raise ValueError(message)
        if self._follower is None or not self._outbox.is_open:
            return
        for start in range(0, len(commands), MAX_RECORDS_PER_MESSAGE):
            part = commands[start : start + MAX_RECORDS_PER_MESSAGE]
            self._outbox.put(len(part), encode_event(COMMANDS, part.tobytes()))

    def request_frames(self, ranges: Iterable[Range]) -> None:
        """Ask the follower for frames that did not arrive; nothing happens without one."""
        if self._follower is not None and self._outbox.is_open:
            self._filling.ask(self._outbox, ranges)

    def send_extra(self, records: RecordArray) -> None:
        """Queue records (n,) of the scene's further event for the follower; never waits."""
        if self._extra is not None and self._follower is not None and self._outbox.is_open:
            self._outbox.put(0, self._extra.encode(records))

    # --- what python-socketio calls

    def _on_connect(self, sid: str, environ: Mapping[str, object], auth: object = None) -> None:
        occupant = self._follower
        try:
            hello = admit(
                auth,
                self._access,
                self._channels,
                self._rate_hz,
                occupant=None if occupant is None else occupant.hello,
                extra="" if self._extra is None else self._extra.event,
            )
            if occupant is not None:
                self._replace(occupant)
            self._events.on_follower(hello)
        except MmtError as error:
            LOG.warning("refused a follower: %s", printable(str(error), MAX_SENTENCE))
            raise socketio.exceptions.ConnectionRefusedError(str(error)) from error
        except Exception as error:
            self._events.on_error(error)
            raise socketio.exceptions.ConnectionRefusedError("the leader failed") from error
        self._follower = _Follower(sid, hello)
        self._excess = ""
        self._left.clear()
        self._reader.restart()
        self.clock.meet(hello.clock_id)
        if self._extra is not None:
            self._extra.restart()
        handlers = {event: partial(take, sid) for event, take in self._frequent.items()}
        self._gate.open()
        self._sockets.let_in(environ, handlers, self._gate)
        send = self._sockets.send(sid, environ)
        self._greeting = asyncio.get_running_loop().create_task(self._greet(sid, send))

    def _replace(self, occupant: _Follower) -> None:
        """Drop a connection that the follower itself has given up."""
        self._on_disconnect(occupant.sid, "it connects anew")
        self._dropping = asyncio.get_running_loop().create_task(
            self._server.disconnect(occupant.sid)
        )

    def _on_disconnect(self, sid: str, reason: str) -> None:
        follower = self._follower
        if follower is None or follower.sid != sid:
            return
        self._follower = None
        self._outbox.close()
        self._left.set()
        if not follower.ended and not self._stopping:
            why = self._excess or loss_of(reason)
            call(self._events.on_lost, why, on_error=self._events.on_error)

    def _on_frames(self, sid: str, *arguments: object) -> None:
        arrival_ns = time.monotonic_ns()
        if not self._expects(sid):
            return
        block = self._reader.read(arguments, arrival_ns)
        if block is not None:
            call(self._events.on_frames, block, arrival_ns, on_error=self._events.on_error)

    def _on_clock(self, sid: str, *arguments: object) -> None:
        if self._expects(sid):
            self.clock.take_question(*arguments)

    def _on_jump(self, jump: ClockJump) -> None:
        call(self._events.on_jump, jump, on_error=self._events.on_error)

    def _on_extra(self, sid: str, *arguments: object) -> None:
        if self._extra is not None and self._expects(sid):
            self._extra.read(arguments, self._events.on_error)

    def _on_end(self, sid: str, *arguments: object) -> None:
        if not self._expects(sid) or self._follower is None:
            return
        arrival_ns = time.monotonic_ns()
        payload = arguments[0] if len(arguments) == 1 else None
        reason = reason_of(payload)
        sent = payload.get("frames") if isinstance(payload, Mapping) else None
        if reason is None or not isinstance(sent, int):
            self._reader.reject("malformed end")
            return
        self._reader.end(sent, arrival_ns)
        self._follower.ended = True
        self._outbox.close()
        call(self._events.on_end, reason, on_error=self._events.on_error)

    # --- the rest

    def _on_shut(self, fault: MmtError) -> None:
        self._excess = str(fault)
        LOG.warning("the follower is cut off: %s", fault)

    def _expects(self, sid: str) -> bool:
        """Whether this is the follower, and still in its session."""
        follower = self._follower
        return follower is not None and follower.sid == sid and not follower.ended

    async def _greet(self, sid: str, send: Send) -> None:
        greeting = {
            "protocol": PROTOCOL_VERSION,
            "clock_id": clock_id(),
            "session_id": self._session_id,
        }
        await self._server.emit(WELCOME, greeting, to=sid)
        await self._tell_network()
        if self._follower is not None and self._follower.sid == sid:
            self._outbox.open(send)

    async def _tell_network(self) -> None:
        """Let the follower emulate the same network as this side."""
        if self._network is not None and self._follower is not None:
            await self._server.emit(NETWORK, self._network.payload(), to=self._follower.sid)
