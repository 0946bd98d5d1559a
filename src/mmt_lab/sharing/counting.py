"""Listeners that count messages and keep no model, many in one process.

`count` is a function for a process of its own. Its client is a light one: the library's uses
several tasks and timers for each message. A thousand such clients would keep both processors of a
small machine busy, and dominate what is measured.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, Final

import aiohttp
import msgpack
import numpy as np

from mmt.core.errors import InputError
from mmt.link.access import Access
from mmt.link.incoming import PeriodLimit
from mmt.link.protocol import CONNECT_PACKET, EVENT_NAMESPACE, MSGPACK_EVENT, encode_event
from mmt.link.websocket import LINK_PATH
from mmt.texture.model.file_arrays import file_arrays
from mmt_share.changes import ModelReplica, digest
from mmt_share.client import ANSWER_PERIOD_S
from mmt_share.lag import FIRST_ANSWERS, ListenerState
from mmt_share.messages import (
    AGAIN,
    CHANGE,
    END,
    HAVE,
    MODEL,
    STATE,
    STATE_DTYPE,
    TOKEN_VARIABLE,
    WELCOME,
    Hello,
    ModelDescription,
)
from mmt_share.tables import Listening

_CONNECT_ERROR: Final = 4
"""Type of a Socket.IO packet that refuses a connection."""
_PING, _PONG = "2", "3"
"""Engine.IO packets."""

_JOINING: Final = 10
"""Listeners of this process that connect at the same time."""
_PATIENCE_S: Final = 30.0


class PlainSocket:
    """One connection, of Engine.IO 4 over a WebSocket with the msgpack serializer."""

    def __init__(
        self, on_event: Callable[..., Awaitable[None]], on_lost: Callable[[], None]
    ) -> None:
        self._on_event, self._on_lost = on_event, on_lost
        self._http = aiohttp.ClientSession()
        self._socket: aiohttp.ClientWebSocketResponse | None = None
        self._reading: asyncio.Task[None] | None = None

    async def open(self, url: str, auth: Mapping[str, Any], timeout_s: float) -> str:
        """Connect; return an empty string, or the reason if that was not possible."""
        try:
            async with asyncio.timeout(timeout_s):
                address = f"{url}{LINK_PATH}?EIO=4&transport=websocket"
                self._socket = await self._http.ws_connect(address, max_msg_size=0)
                await self._socket.receive()  # Engine.IO is open
                packet = {"type": CONNECT_PACKET, "data": dict(auth), "nsp": EVENT_NAMESPACE}
                await self._socket.send_bytes(msgpack.packb(packet))
                answer = msgpack.unpackb(await self._socket.receive_bytes())
        except (aiohttp.ClientError, OSError, TimeoutError, TypeError) as error:
            return str(error) or f"no answer within {timeout_s:g} s"
        if answer["type"] == _CONNECT_ERROR:
            return str(answer["data"]["message"])
        self._reading = asyncio.create_task(self._read(self._socket))
        return ""

    async def emit(self, event: str, argument: object) -> None:
        """Send an event."""
        if self._socket is not None and not self._socket.closed:
            await self._socket.send_bytes(encode_event(event, argument))

    async def close(self) -> None:
        """Close the connection."""
        if self._reading is not None:
            self._reading.cancel()
            await asyncio.gather(self._reading, return_exceptions=True)
        if self._socket is not None:
            await self._socket.close()
        await self._http.close()

    async def _read(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        async for message in socket:
            if message.type == aiohttp.WSMsgType.BINARY:
                packet = msgpack.unpackb(message.data)
                if packet["type"] == MSGPACK_EVENT:
                    await self._on_event(*packet["data"])
            elif message.data == _PING:
                await socket.send_str(_PONG)
        self._on_lost()


class CountingReplica(ModelReplica):
    """Replica that checks that every change follows the state before, and keeps its digest alone.

    The leader computes the digest from its own arrays. A listener that has received a whole model
    and each change since has a model with that digest.
    """

    def __init__(self) -> None:
        super().__init__()
        self._file = self._digest = b""

    def take(self, event: str, message: Any) -> None:
        """Take a whole model or a change."""
        if event == CHANGE and (message["since"] != self.number or not self.number):
            raise InputError("a change is missing")
        self.about = ModelDescription.from_message(message)
        if event == MODEL:
            self._file = message["file"]
        self._digest = message.get("digest", b"")

    def digest(self) -> str:
        """Return the digest of the model in hexadecimal digits, empty before there is one."""
        if not self.number:
            return ""
        return (self._digest or digest(file_arrays(self._file))).hex()


@dataclass
class ListenerCounts:
    """Counts and times of one listener.

    Attributes
    ----------
    first_s
        Seconds from its first attempt to connect to its first model.
    lags_ms
        Time from the making of each change of the model until it arrived, by the same clock.
    number, digest
        Number and digest of its last model.
    wholes, changes, states, rejected
        Messages received; `rejected` counts the changes that did not fit.
    problem
        Why it could not connect, or did not stay; empty if it did.
    """

    first_s: float | None = None
    lags_ms: list[float] = field(default_factory=list)
    number: int = 0
    digest: str = ""
    wholes: int = 0
    changes: int = 0
    states: int = 0
    rejected: int = 0
    problem: str = ""


class CountingListener:
    """One listener that counts."""

    def __init__(self, url: str, auth: Mapping[str, Any]) -> None:
        self.replica = CountingReplica()
        self.ended = asyncio.Event()
        self.found = ListenerCounts()
        self._begun_s = 0.0
        self._url, self._auth = url, auth
        self._asked = False
        self._answers, self._answering = 0, PeriodLimit(ANSWER_PERIOD_S)
        self._socket = PlainSocket(self._hear, self._lose)

    async def join(self) -> None:
        """Connect."""
        self._begun_s = time.monotonic()
        self.found.problem = await self._socket.open(self._url, self._auth, _PATIENCE_S)
        if self.found.problem:
            self.ended.set()

    async def leave(self) -> ListenerCounts:
        """Disconnect; return the counts."""
        self.ended.set()
        await self._socket.close()
        self.found.number, self.found.digest = self.replica.number, self.replica.digest()
        return self.found

    def _lose(self) -> None:
        if not self.ended.is_set():
            self.found.problem = "the connection was lost"
            self.ended.set()

    async def _hear(self, event: str, argument: Any = None) -> None:
        if event == STATE:
            self.found.states += 1
            await self._answer(argument)
        elif event == CHANGE and not self._asked:
            self.found.changes += 1
            await self._take_change(argument)
        elif event == MODEL:
            self._asked = False
            self.found.wholes += 1
            self.replica.take(MODEL, argument)
            if self.found.first_s is None:
                self.found.first_s = time.monotonic() - self._begun_s
            self._note_lag()
        elif event == WELCOME:
            await self._ask()
        elif event == END:
            self.ended.set()

    async def _take_change(self, message: object) -> None:
        try:
            self.replica.take(CHANGE, message)
        except InputError:
            self.found.rejected += 1
            await self._ask()
        else:
            self._note_lag()

    def _note_lag(self) -> None:
        if self.found.changes and self.replica.about is not None:
            made_ns = self.replica.about.made_ns
            self.found.lags_ms.append(1e-6 * (time.monotonic_ns() - made_ns))

    async def _ask(self) -> None:
        self._asked = True
        await self._socket.emit(AGAIN, None)

    async def _answer(self, state: bytes) -> None:
        """Report the number of the newest model, as often as a real listener does."""
        now_ns = time.monotonic_ns()
        if self._answers < FIRST_ANSWERS or self._answering.passes(1e-9 * now_ns):
            self._answers += 1
            time_s = float(np.frombuffer(state, STATE_DTYPE)[0]["time_s"])
            await self._socket.emit(HAVE, ListenerState(self.replica.number, now_ns, time_s).pack())


def auth_of(url: str, states_hz: float | None = None) -> dict[str, Any]:
    """Return the ``auth`` of a listener at a URL: its hello, and the token if there is one."""
    token = Access.from_settings(Listening(url=url), variable=TOKEN_VARIABLE).token
    return Hello(states_hz=states_hz).as_auth() | ({} if token is None else {"token": token})


async def run_listeners(
    url: str,
    listeners: int,
    longest_s: float,
    *,
    within_s: float = 0.0,
    states_hz: float | None = None,
    on_joined: Callable[[float], None] = lambda _: None,
) -> list[ListenerCounts]:
    """Let listeners join, and count until the session has ended for each of them.

    They join over `within_s` seconds, at most ten at a time; `on_joined` is called with the seconds
    that joining took. `states_hz` is as for `auth_of`.
    """
    begun_s = time.monotonic()
    auth, joining = auth_of(url, states_hz), asyncio.Semaphore(_JOINING)
    crowd = [CountingListener(url, auth) for _ in range(listeners)]

    async def join(number: int, one: CountingListener) -> None:
        await asyncio.sleep(within_s * number / listeners)
        async with joining:
            await one.join()

    await asyncio.gather(*(join(number, one) for number, one in enumerate(crowd)))
    on_joined(time.monotonic() - begun_s)
    ends = [asyncio.create_task(one.ended.wait()) for one in crowd]
    _, late = await asyncio.wait(ends, timeout=longest_s)
    for each in late:
        each.cancel()
    return list(await asyncio.gather(*(one.leave() for one in crowd)))


async def count(pipe: Connection, url: str, longest_s: float, listeners: int) -> None:
    """Run listeners; send the seconds that joining took, and what each has counted."""
    pipe.send(await run_listeners(url, listeners, longest_s, on_joined=pipe.send))
