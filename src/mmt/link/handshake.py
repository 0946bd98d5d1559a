"""The handshake at the leader: whether a follower may connect, and its slot until it leaves."""

import asyncio
import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import socketio

from mmt.core.errors import InputError, MmtError
from mmt.core.output.logs import RepeatLimit
from mmt.core.running.ending import start_task
from mmt.core.running.process import clock_id
from mmt.link.access import REFUSED, Access
from mmt.link.clock_exchange import ClockResponder
from mmt.link.endpoint import Endpoint, LeaderEvents
from mmt.link.protocol import (
    MAX_SENTENCE,
    NETWORK,
    WELCOME,
    FollowerHello,
    loss_of,
    peer_text,
)
from mmt.link.serving.http import LinkServer
from mmt.link.websocket import Send

if TYPE_CHECKING:
    from mmt.link.emulated.network import EmulatedNetwork

LOG: Final = logging.getLogger("mmt.link")


def admit(
    auth: object,
    occupant: FollowerHello | None,
    *,
    access: Access,
    expected: FollowerHello,
) -> FollowerHello:
    """Validate a connecting follower and return its hello.

    Parameters
    ----------
    auth
        The ``auth`` of the connection, which is not trusted.
    occupant
        Hello of the follower that is connected, or None. The same process may replace it: it
        knows that its old connection is dead before the leader does.
    access
        The token that is required.
    expected
        Has the rates, the channels and the further event of the leader's scene.

    Raises
    ------
    MmtError
        The token is wrong (nothing else is revealed then), or another follower is connected.
    InputError
        The follower does not fit the leader's scene; the message is for the follower's user.
    """
    if not access.admits(auth.get("token") if isinstance(auth, Mapping) else None):
        raise MmtError(REFUSED)
    hello = FollowerHello.from_auth(auth)
    if occupant is not None and not (hello.run_id and hello.run_id == occupant.run_id):
        raise MmtError("another follower is connected: one leader serves one follower")
    if hello.rate_hz != expected.rate_hz:
        raise InputError(
            f"the follower streams at {hello.rate_hz} Hz, the leader's scene expects "
            f"{expected.rate_hz} Hz: use the same scene on both"
        )
    if hello.channels != expected.channels:
        raise InputError(
            f"the follower sends {', '.join(hello.channels)}, the leader's scene needs "
            f"{', '.join(expected.channels)}: use the same scene on both"
        )
    if hello.samples_per_frame != expected.samples_per_frame:
        raise InputError(
            f"the follower sends {hello.samples_per_frame} samples of acceleration a frame, the "
            f"leader's scene needs {expected.samples_per_frame} (acceleration_rate_hz of "
            "[session]): use the same scene on both"
        )
    if hello.extra != expected.extra:
        raise InputError(
            f"the follower has {hello.extra[:20] or 'nothing'} beside its frames, the leader's "
            f"scene {expected.extra or 'nothing'} (method of [force_feedback], hand_force of "
            "[handle]): use the same scene on both"
        )
    return hello


class FollowerSlot:
    """The leader's one slot for a follower: it admits and welcomes one, and is free once it leaves.

    Parameters
    ----------
    host
        The server to which followers connect.
    endpoint, clock
        Restarted with each follower.
    events
        Callbacks of the service.
    access, expected
        As of `admit`.
    session_id
        Identifier of the session.
    network
        Network emulated by both sides, or None.
    """

    def __init__(
        self,
        host: LinkServer,
        endpoint: Endpoint,
        clock: ClockResponder,
        events: LeaderEvents,
        *,
        access: Access,
        expected: FollowerHello,
        session_id: str,
        network: "EmulatedNetwork | None",
    ) -> None:
        self.sid: str | None = None
        """Socket.IO session of the follower, None while the slot is free."""
        self.hello: FollowerHello | None = None
        """Hello of the follower."""
        self.fault = ""
        """Why the follower is being cut off, empty if it is not."""
        self._ended = self._closed = False
        self._free = asyncio.Event()
        self._host = host
        self._endpoint = endpoint
        self._clock = clock
        self._events = events
        self._access, self._expected = access, expected
        self._frequent: dict[str, Callable[..., Any]] = {}
        self._session_id = session_id
        self._network = network
        self._refusals = RepeatLimit()
        self._tasks: set[asyncio.Task[None]] = set()
        host.server.on("connect", self._on_connect)
        host.server.on("disconnect", self._on_disconnect)
        if network is not None:
            network.serve(host.application, self._send_network)

    def handle(
        self, frequent: Mapping[str, Callable[..., Any]], others: Mapping[str, Callable[..., Any]]
    ) -> None:
        """Call these handlers with the arguments of the follower's events, by name.

        Events of another connection, or after the session's end, are ignored. Frequent ones bypass
        the library if possible.
        """

        def of_follower(handler: Callable[..., Any]) -> Callable[..., Any]:
            return lambda sid, *arguments: handler(*arguments) if self.expects(sid) else None

        self._frequent = {event: of_follower(handler) for event, handler in frequent.items()}
        for event, handler in others.items():
            self._host.server.on(event, of_follower(handler))
        for event, guarded in self._frequent.items():
            self._host.server.on(event, guarded)

    @property
    def in_session(self) -> bool:
        """Whether a follower is connected that has not ended the session."""
        return self.sid is not None and not self._ended

    def expects(self, sid: str) -> bool:
        """Return whether this connection is the follower's and its session goes on."""
        return self.sid == sid and not self._ended

    def assign(self, sid: str, hello: FollowerHello) -> None:
        """Assign the slot to a follower."""
        self.sid, self.hello = sid, hello
        self.fault = ""
        self._ended = False
        self._free.clear()

    def end(self) -> None:
        """Mark the session as ended; the slot is not free yet."""
        self._ended = True

    def cut_off(self, fault: MmtError) -> None:
        """Mark the follower as cut off for exceeding the rate limit."""
        self.fault = str(fault)
        LOG.warning("the follower is cut off: %s", fault)

    def release(self) -> None:
        """Free the slot."""
        self.sid = self.hello = None
        self._free.set()

    async def wait_until_free(self, timeout_s: float) -> bool:
        """Wait until the slot is free, at most `timeout_s`; return whether it is."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._free.wait(), timeout_s)
        return self._free.is_set()

    def close(self) -> None:
        """Admit no more followers; one that disconnects from now on is not reported as lost."""
        self._closed = True
        for task in self._tasks:
            task.cancel()

    def _on_connect(self, sid: str, environ: Mapping[str, object], auth: object = None) -> None:
        try:
            hello = admit(auth, self.hello, access=self._access, expected=self._expected)
            self._drop_earlier()
            self._events.on_follower(hello)
        except MmtError as error:
            self._refusals.warn(LOG, f"refused a follower: {peer_text(str(error), MAX_SENTENCE)}")
            raise socketio.exceptions.ConnectionRefusedError(str(error)) from error
        except Exception as error:
            self._events.on_error(error)
            raise socketio.exceptions.ConnectionRefusedError("the leader failed") from error
        self.assign(sid, hello)
        self._endpoint.restart()
        self._clock.start_connection(hello.clock_id)
        handlers = {event: partial(handle, sid) for event, handle in self._frequent.items()}
        self._endpoint.rate_limit.open()
        self._host.sockets.admit(environ, handlers, self._endpoint.rate_limit)
        send = self._host.sockets.send(sid, environ)
        start_task(self._send_welcome(sid, hello.protocol, send), self._tasks)

    def _drop_earlier(self) -> None:
        """Drop the earlier connection of a follower that connects again."""
        occupant = self.sid
        if occupant is not None:
            self._on_disconnect(occupant, "it connects anew")
            start_task(self._host.server.disconnect(occupant), self._tasks)

    def _on_disconnect(self, sid: str, reason: str) -> None:
        if self.sid != sid:
            return
        lost = self.in_session and not self._closed
        self.release()
        self._endpoint.outbox.close()
        if lost:
            self._endpoint.notify(self._events.on_lost, self.fault or loss_of(reason))

    async def _send_welcome(self, sid: str, protocol: int, send: Send) -> None:
        welcome = {
            "protocol": protocol,
            "clock_id": clock_id(),
            "session_id": self._session_id,
        }
        await self._host.server.emit(WELCOME, welcome, to=sid)
        await self._send_network()
        if self.sid == sid:
            self._endpoint.outbox.open(send)

    async def _send_network(self) -> None:
        """Send the emulated network's settings, so that the follower emulates the same one."""
        if self._network is not None and self.sid is not None:
            await self._host.server.emit(NETWORK, self._network.payload(), to=self.sid)
