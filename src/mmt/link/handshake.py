"""The handshake at the leader: whether a follower may connect, and its slot until it leaves."""

import asyncio
import logging
from collections.abc import Callable, Coroutine, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Final

import socketio

from mmt.core.errors import InputError, MmtError
from mmt.core.frames import Channel
from mmt.core.process import clock_id
from mmt.link.access import REFUSED, Access
from mmt.link.clock_exchange import ClockResponder
from mmt.link.endpoint import Endpoint, LeaderEvents
from mmt.link.http import LinkServer
from mmt.link.protocol import (
    MAX_SENTENCE,
    NETWORK,
    PROTOCOL_VERSION,
    WELCOME,
    FollowerHello,
    loss_of,
    printable,
)
from mmt.link.websocket import Send

if TYPE_CHECKING:
    from mmt.link.emulation import EmulatedNetwork

LOG: Final = logging.getLogger("mmt.link")


class FollowerSlot:
    """Who is served, and whether the session with them goes on."""

    def __init__(self) -> None:
        self.sid: str | None = None
        """Of the Socket.IO connection of the follower, None where nobody is served."""
        self.hello: FollowerHello | None = None
        """What the follower says of itself."""
        self.fault = ""
        """Why the follower is being cut off, empty where it is not."""
        self._ended = False
        self._free = asyncio.Event()

    @property
    def in_session(self) -> bool:
        """Whether a follower is there that has not ended the session."""
        return self.sid is not None and not self._ended

    def expects(self, sid: str) -> bool:
        """Whether this is the follower, and still in its session."""
        return self.sid == sid and not self._ended

    def take(self, sid: str, hello: FollowerHello) -> None:
        """Give the place to a follower."""
        self.sid, self.hello = sid, hello
        self.fault = ""
        self._ended = False
        self._free.clear()

    def end(self) -> None:
        """Take note that the follower has ended the session; its place is not free yet."""
        self._ended = True

    def cut_off(self, fault: MmtError) -> None:
        """Take note that the follower's connection is closed since it sends too much."""
        self.fault = str(fault)
        LOG.warning("the follower is cut off: %s", fault)

    def leave(self) -> None:
        """Free the place."""
        self.sid = self.hello = None
        self._free.set()

    async def until_free(self, timeout_s: float) -> bool:
        """Wait until the place is free, for at most this long; return whether it is."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._free.wait(), timeout_s)
        return self._free.is_set()


def admit(
    auth: object,
    occupant: FollowerHello | None,
    *,
    access: Access,
    channels: Sequence[Channel],
    rate_hz: int,
    extra: str = "",
) -> FollowerHello:
    """Return the hello of a follower that fits the leader's scene.

    Parameters
    ----------
    auth
        Of the connection, as anybody may have sent it.
    occupant
        Of the follower that is connected, None where none is. Its own process may take its
        place: it knows that its old connection is dead before the leader does.
    access
        What the leader asks for.
    channels, rate_hz
        What the leader's scene needs.
    extra
        The further event that the leader's scene has on the wire, empty for none.

    Raises
    ------
    MmtError
        It has not the leader's token; nothing else is told to it. Or it is the second.
    InputError
        It does not fit; the sentence is for the follower's user.
    """
    if not access.admits(auth.get("token") if isinstance(auth, Mapping) else None):
        raise MmtError(REFUSED)
    hello = FollowerHello.from_auth(auth)
    if occupant is not None and not (hello.run_id and hello.run_id == occupant.run_id):
        raise MmtError("another follower is connected: one leader serves one follower")
    if hello.rate_hz != rate_hz:
        raise InputError(
            f"the follower streams at {hello.rate_hz} Hz, the leader's scene expects "
            f"{rate_hz} Hz: use the same scene on both"
        )
    if hello.channels != tuple(channels):
        raise InputError(
            f"the follower sends {', '.join(hello.channels)}, the leader's scene needs "
            f"{', '.join(channels)}: use the same scene on both"
        )
    if hello.extra != extra:
        raise InputError(
            f"the follower has {hello.extra[:20] or 'nothing'} beside its frames, the leader's "
            f"scene {extra or 'nothing'} (method of [force_feedback]): use the same scene on both"
        )
    return hello


Admit = Callable[[object, FollowerHello | None], FollowerHello]
"""Returns the hello of a follower's ``auth`` that may be served in place of the one that is
there, or raises MmtError with a sentence for its user."""


class Handshake:
    """Let a follower in, greet it, and take note when it has gone.

    Parameters
    ----------
    host
        Where followers connect.
    place
        The one that they get.
    traffic, clock
        Begin anew with each of them.
    events
        What to call.
    admit
        Says who may be served.
    frequent
        What to call for frequent events, past the library where it can be; with the sid.
    session_id
        Names the session.
    network
        Emulated by both sides.
    """

    def __init__(
        self,
        host: LinkServer,
        place: FollowerSlot,
        traffic: Endpoint,
        clock: ClockResponder,
        events: LeaderEvents,
        admit: Admit,
        frequent: Mapping[str, Callable[..., None]],
        *,
        session_id: str,
        network: "EmulatedNetwork | None",
    ) -> None:
        self._host = host
        self._place = place
        self._traffic = traffic
        self._clock = clock
        self._events = events
        self._admit = admit
        self._frequent = frequent
        self._session_id = session_id
        self._network = network
        self._closed = False
        self._tasks: set[asyncio.Task[None]] = set()
        host.server.on("connect", self._on_connect)
        host.server.on("disconnect", self._on_disconnect)
        if network is not None:
            network.serve(host.application, self._tell_network)

    def close(self) -> None:
        """Greet nobody any more; who goes from now on is not lost."""
        self._closed = True
        for task in self._tasks:
            task.cancel()

    def _on_connect(self, sid: str, environ: Mapping[str, object], auth: object = None) -> None:
        try:
            hello = self._admit(auth, self._place.hello)
            self._clear_place()
            self._events.on_follower(hello)
        except MmtError as error:
            LOG.warning("refused a follower: %s", printable(str(error), MAX_SENTENCE))
            raise socketio.exceptions.ConnectionRefusedError(str(error)) from error
        except Exception as error:
            self._events.on_error(error)
            raise socketio.exceptions.ConnectionRefusedError("the leader failed") from error
        self._place.take(sid, hello)
        self._traffic.restart()
        self._clock.meet(hello.clock_id)
        handlers = {event: partial(take, sid) for event, take in self._frequent.items()}
        self._traffic.gate.open()
        self._host.sockets.let_in(environ, handlers, self._traffic.gate)
        self._begin(self._greet(sid, self._host.sockets.send(sid, environ)))

    def _clear_place(self) -> None:
        """Drop a connection that the follower itself has given up."""
        occupant = self._place.sid
        if occupant is not None:
            self._on_disconnect(occupant, "it connects anew")
            self._begin(self._host.server.disconnect(occupant))

    def _on_disconnect(self, sid: str, reason: str) -> None:
        place = self._place
        if place.sid != sid:
            return
        lost = place.in_session and not self._closed
        place.leave()
        self._traffic.outbox.close()
        if lost:
            self._traffic.tell(self._events.on_lost, place.fault or loss_of(reason))

    async def _greet(self, sid: str, send: Send) -> None:
        greeting = {
            "protocol": PROTOCOL_VERSION,
            "clock_id": clock_id(),
            "session_id": self._session_id,
        }
        await self._host.server.emit(WELCOME, greeting, to=sid)
        await self._tell_network()
        if self._place.sid == sid:
            self._traffic.outbox.open(send)

    async def _tell_network(self) -> None:
        """Let the follower emulate the same network as this side."""
        if self._network is not None and self._place.sid is not None:
            await self._host.server.emit(NETWORK, self._network.payload(), to=self._place.sid)

    def _begin(self, doing: Coroutine[object, object, None]) -> None:
        task = asyncio.get_running_loop().create_task(doing)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
