"""How a follower comes to the leader and leaves it: one at a time."""

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from functools import partial
from typing import TYPE_CHECKING

import socketio

from mmt.core.errors import MmtError
from mmt.link.clock import clock_id
from mmt.link.clock_exchange import ClockAnswerer
from mmt.link.direct import Send
from mmt.link.events import LeaderEvents
from mmt.link.hosting import LinkHost
from mmt.link.log import LOG
from mmt.link.place import FollowerPlace
from mmt.link.protocol import (
    MAX_SENTENCE,
    NETWORK,
    PROTOCOL_VERSION,
    WELCOME,
    FollowerHello,
    loss_of,
    printable,
)
from mmt.link.traffic import Traffic

if TYPE_CHECKING:
    from mmt.link.network import EmulatedNetwork

Admit = Callable[[object, FollowerHello | None], FollowerHello]
"""Returns the hello of a follower's ``auth`` that may be served in place of the one that is
there, or raises MmtError with a sentence for its user."""


class Reception:
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
        host: LinkHost,
        place: FollowerPlace,
        traffic: Traffic,
        clock: ClockAnswerer,
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
