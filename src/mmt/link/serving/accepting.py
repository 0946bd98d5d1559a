"""Accept TCP connections, and keep strangers from using up the places of permitted clients.

Anyone who reaches a port can open connections and leave them idle. A connection that is not
admitted is called a stranger. A stranger has two seconds for TLS and its first request's headers;
if there are too many strangers, the oldest one of the address with the most strangers is closed.
A connection that was admitted (by its token, its certificate, or as the follower) stays.

This module accepts one socket in each turn of the event loop, because asyncio's own server
accepts a hundred in a row and, if descriptors run out, logs as many errors.
"""

import asyncio
import errno
import logging
import socket
import ssl
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final
from weakref import WeakValueDictionary

from aiohttp import web
from aiohttp.typedefs import Handler

from mmt.core.output.logs import RepeatLimit

if TYPE_CHECKING:
    from mmt.link.serving.gate import Gate

LOG: Final = logging.getLogger("mmt.link")

HANDSHAKE_S: Final = 2.0
"""Longest time of a connection for TLS and its first request, and then for its admission."""
MOST_STRANGERS: Final = 64
"""Most strangers at once, and most admitted connections at once, by default."""
MOST_OF_ADDRESS: Final = 32
"""Most strangers of one address: more than a browser, or a follower that retries, opens."""

_MOST_REQUESTS: Final = 20
"""Most requests on a stranger's connection, if clients must authenticate; browsers open another."""
_SPACING_S: Final = 0.02
"""Time between two connections during a session, because each one costs half a tick."""
_TURN_S: Final = 0.4
"""The same for two connections of one address; the later one waits, and nothing of it is read."""
_PAUSE_S: Final = 0.1
"""Pause before the next connection is accepted if descriptors have run out."""
_WAITING: Final = 128
"""Connections that the system holds until they are accepted."""
_NO_SUCH_ADDRESS: Final = {errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT}
"""Errors to ignore: a host name may have an IPv6 address although the machine has no IPv6."""
_FEW: Final = 256
"""Number of descriptors to assume if the system sets no limit."""


def _listening_sockets(addresses: Iterable[tuple[int, Any]]) -> list[socket.socket]:
    """Return a listening socket for each address (family, address) that this machine has.

    Raises
    ------
    OSError
        An address is in use or not permitted, or the machine has none of them.
    """
    sockets: list[socket.socket] = []
    problem: OSError | None = None
    for family, address in addresses:
        try:
            listening = socket.create_server(address, family=family, backlog=_WAITING)
        except OSError as error:
            problem = error
            if error.errno not in _NO_SUCH_ADDRESS:
                break
        else:
            listening.setblocking(False)
            sockets.append(listening)
    if problem is not None and (not sockets or problem.errno not in _NO_SUCH_ADDRESS):
        for listening in sockets:
            listening.close()
        raise problem
    return sockets


def descriptors() -> int:
    """Return how many files and sockets this process may open."""
    try:
        import resource
    except ImportError:
        return _FEW  # Windows has no such limit
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return _FEW if soft == resource.RLIM_INFINITY else soft


@dataclass(eq=False)
class Connection:
    """A connection, from its arrival on."""

    address: str
    protocol: web.RequestHandler
    gate: "Gate | None"
    opening: "asyncio.Task[None] | None" = None
    heard: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when the first request has come."""
    admitted: bool = False
    requests: int = 0

    @property
    def is_closed(self) -> bool:
        """Whether the connection is closed."""
        if self.opening is not None:
            return False
        transport = self.protocol.transport
        return transport is None or transport.is_closing()

    def close(self) -> None:
        """Close the connection at once."""
        if self.opening is not None:
            self.opening.cancel()
        if self.protocol.transport is not None:
            self.protocol.transport.abort()


class Acceptor:
    """Listens on a host and port, and bounds the connections there.

    Parameters
    ----------
    busy
        Returns whether a session is under way, which many strangers at once would disturb.
    most
        Most strangers at once, and most admitted connections at once; None for
        `MOST_STRANGERS`.
    """

    def __init__(self, busy: Callable[[], bool], most: int | None = None) -> None:
        self._busy = busy
        most = MOST_STRANGERS if most is None else most
        self._most = min(most, descriptors() // 4)
        self._most_of_address = max(MOST_OF_ADDRESS, most // 2)
        self._connections: dict[web.RequestHandler, Connection] = {}  # the oldest first
        self._turns: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()
        self._sockets: list[socket.socket] = []
        self._accepting: list[asyncio.Task[None]] = []
        self._told = RepeatLimit()
        self._gate: type[Gate] | None = None

    @property
    def port(self) -> int:
        """The port that is listened on, 0 before `start`."""
        return int(self._sockets[0].getsockname()[1]) if self._sockets else 0

    async def start(
        self,
        host: str,
        port: int,
        runner: web.AppRunner,
        tls: ssl.SSLContext | None,
        *,
        guarded: bool,
    ) -> None:
        """Start to listen.

        Parameters
        ----------
        host, port
            Where to listen; port 0 takes any free one.
        runner
            Makes the protocol of each connection; must be set up.
        tls
            TLS of the connections, or None.
        guarded
            Whether clients must authenticate, and may send little before.

        Raises
        ------
        OSError
            The host or the port cannot be used.
        """
        if guarded:
            from mmt.link.serving.gate import Gate

            self._gate = Gate
        loop, make = asyncio.get_running_loop(), runner.server
        assert make is not None  # noqa: S101 - the runner is set up
        found = await loop.getaddrinfo(
            host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        self._sockets = _listening_sockets((info[0], info[4]) for info in dict.fromkeys(found))
        self._accepting = [
            loop.create_task(self._accept(listening, make, tls)) for listening in self._sockets
        ]

    async def stop(self) -> None:
        """Stop listening, and close connections that are not open yet."""
        opening = [c.opening for c in self._connections.values() if c.opening is not None]
        for task in (*self._accepting, *opening):
            task.cancel()
        await asyncio.gather(*self._accepting, *opening, return_exceptions=True)
        for listening in self._sockets:
            listening.close()
        self._sockets.clear()

    def record_request(self, protocol: web.RequestHandler) -> bool:
        """Note a request; return whether its connection may stay open for another one."""
        connection = self._connections.get(protocol)
        if connection is None:
            return True
        connection.heard.set()
        connection.requests += 1
        return connection.gate is None or connection.requests < _MOST_REQUESTS

    def admit(self, protocol: web.RequestHandler) -> None:
        """Admit this protocol's connection, so that no stranger displaces it, if there is room."""
        connection = self._connections.get(protocol)
        if connection is None:
            return
        if connection.gate is not None:
            connection.gate.open()
            connection.gate = None
        if len(self._having(admitted=True)) < self._most:
            connection.admitted = True

    def _having(self, *, admitted: bool) -> list[Connection]:
        """Return the open connections that are admitted, or are not; the oldest first."""
        self._connections = {p: c for p, c in self._connections.items() if not c.is_closed}
        return [c for c in self._connections.values() if c.admitted is admitted]

    async def _accept(
        self, listening: socket.socket, make: web.Server, tls: ssl.SSLContext | None
    ) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                arrived, address = await loop.sock_accept(listening)
            except ConnectionError:
                continue  # the client left before it was accepted
            except OSError as error:
                self._told.warn(LOG, f"no connection can be accepted ({error.strerror or error})")
                self._make_room(self._having(admitted=False)[:1])
                await asyncio.sleep(_PAUSE_S)
                continue
            protocol = make()
            gate = None if self._gate is None else self._gate(protocol)
            connection = Connection(str(address[0]), protocol, gate)
            self._make_room(self._supernumerary(connection.address))
            self._connections[connection.protocol] = connection
            connection.opening = loop.create_task(self._open(connection, arrived, tls))
            # sock_accept returns at once while more are waiting
            await asyncio.sleep(_SPACING_S if self._busy() else 0)

    def _supernumerary(self, address: str) -> list[Connection]:
        """Return the stranger to close before one more of this address comes, if any."""
        strangers = self._having(admitted=False)
        counts = Counter(stranger.address for stranger in strangers)
        if counts[address] >= min(self._most_of_address, self._most):
            busiest = address
        elif len(strangers) >= self._most:
            busiest = counts.most_common(1)[0][0]
        else:
            return []
        return [next(stranger for stranger in strangers if stranger.address == busiest)]

    def _make_room(self, strangers: list[Connection]) -> None:
        for stranger in strangers:
            stranger.close()
            del self._connections[stranger.protocol]
            self._told.warn(LOG, f"too many connections: closed the oldest from {stranger.address}")

    async def _open(
        self, connection: Connection, arrived: socket.socket, tls: ssl.SSLContext | None
    ) -> None:
        """Open a connection, and close it unless its first request comes in time."""
        loop, protocol = asyncio.get_running_loop(), connection.gate or connection.protocol
        try:
            await self._turn(connection.address, arrived)
            with suppress(OSError):  # a TLS handshake that fails
                async with asyncio.timeout(HANDSHAKE_S):
                    await loop.connect_accepted_socket(lambda: protocol, arrived, ssl=tls)
                    if tls is not None and tls.verify_mode is ssl.CERT_REQUIRED:
                        self.admit(connection.protocol)
                    await connection.heard.wait()
        finally:
            connection.opening = None
            if not connection.heard.is_set():
                connection.close()

    async def _turn(self, address: str, arrived: socket.socket) -> None:
        """Wait for this address's turn, during a session, before anything is read."""
        turns = self._turns.setdefault(address, asyncio.Lock())
        try:
            await turns.acquire()
        except asyncio.CancelledError:
            arrived.close()  # no transport owns the socket yet
            raise
        if self._busy():
            asyncio.get_running_loop().call_later(_TURN_S, turns.release)
        else:
            turns.release()


_ACCEPTOR: Final = web.AppKey("acceptor", Acceptor)


def watch_connections(application: web.Application, acceptor: Acceptor) -> None:
    """Make an application report each request to its acceptor; call before it is set up."""

    @web.middleware
    async def hear(request: web.Request, handler: Handler) -> web.StreamResponse:
        if not acceptor.record_request(request.protocol):
            request.protocol.close()
        try:
            return await handler(request)
        except ConnectionError:  # the client left before its answer, which is no error
            return web.Response()

    application[_ACCEPTOR] = acceptor
    application.middlewares.insert(0, hear)


def admit_connection(request: web.Request) -> None:
    """Admit the connection of an authenticated request; see `Acceptor.admit`."""
    acceptor = request.app.get(_ACCEPTOR)
    if acceptor is not None:
        acceptor.admit(request.protocol)
