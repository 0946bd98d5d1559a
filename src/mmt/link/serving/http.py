"""HTTP servers: Socket.IO and pages on one port, guarded by the token."""

import asyncio
import socket
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

import socketio
from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from mmt.core.errors import InputError, MmtError
from mmt.link.access import FOLLOWERS, Access, Entrance, check_listening, is_address, is_loopback
from mmt.link.protocol import MAX_MESSAGE_BYTES, PING_INTERVAL_S, PING_TIMEOUT_S
from mmt.link.serving.accepting import Acceptor, admit_connection, watch_connections
from mmt.link.serving.sockets import ServerSockets
from mmt.link.websocket import LINK_PATH, Packet, wire_logger
from mmt.scene.table import ServedTable

if TYPE_CHECKING:
    from prometheus_client import CollectorRegistry

Page = Callable[[web.Application, Access], None]
"""Adds a page to an application; the access decides what a client may see."""

CLOSE_TIMEOUT_S: Final = 1.0
"""Longest time for open connections to end."""

_KEEP_ALIVE_S: Final = 10.0
"""How long a connection without a request stays open."""
_MONITOR_PATH: Final = "/monitor"
"""This page's files are not secret, and its socket asks for the token itself."""
_OPEN: Final = {LINK_PATH, "/health", _MONITOR_PATH}
"""Pages that check the token themselves."""


def guarded_application(access: Access) -> web.Application:
    """Return an application whose pages require the token, as ``Bearer``."""

    @web.middleware
    async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
        path = request.path
        if path in _OPEN or path.startswith(f"{_MONITOR_PATH}/"):
            return await handler(request)
        if not access.admits_header(request.headers.get("Authorization")):
            return web.Response(
                status=401,
                headers={"WWW-Authenticate": "Bearer"},
                text="give the leader's token: Authorization: Bearer TOKEN\n",
            )
        if access.token is not None:
            admit_connection(request)
        return await handler(request)

    return web.Application(middlewares=[guard])


def own_pages_only(
    listening: Callable[[], tuple[str, bool, Access]], origins: Sequence[str] = ()
) -> Middleware:
    """Return a middleware that refuses requests which could come from another site's page.

    A browser that shows another site reaches this port too. So the ``Origin`` of a request, if
    any, must be this server. Another site may also point its host name here (DNS rebinding). So
    without a token or a certificate a request must name an IP address, this machine, or the host
    listened on; beyond loopback, programs, which send no ``Origin``, may use any name.

    Parameters
    ----------
    listening
        Returns the host that is listened on, whether that is loopback, and the access that clients
        need; a look-up of the host's name here would block the loop.
    origins
        Other sites whose pages may connect with the token.
    """

    @web.middleware
    async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
        origin, (host, loopback, access) = request.headers.get("Origin"), listening()
        if origin is not None and origin.lower() in origins and access.token is not None:
            return await handler(request)
        if origin is not None and origin.partition("://")[2].lower() != request.host.lower():
            return web.Response(status=403, text="pages of other sites are refused\n")
        name = ""
        with suppress(ValueError):  # a malformed name is nobody's
            name = urlsplit(f"//{request.host}").hostname or ""
        own = {"localhost", host.lower(), socket.gethostname().lower()}
        if (
            access.authenticates_peer
            or name in own
            or is_address(name)
            or (origin is None and not loopback)
        ):
            return await handler(request)
        return web.Response(
            status=403, text=f"{name!r} is not this server: use its address, or give it a token\n"
        )

    return check


class Listener:
    """A web application on one address and port.

    Parameters
    ----------
    application
        The application.
    entrance
        Who connects, for the errors.
    busy
        Returns whether a session is under way, which many strangers at once would disturb.
    most
        Most connections at once; see `mmt.link.serving.accepting.Acceptor`.
    origins
        Other sites whose pages may connect, see `own_pages_only`.
    """

    def __init__(
        self,
        application: web.Application,
        entrance: Entrance = FOLLOWERS,
        busy: Callable[[], bool] = lambda: False,
        most: int | None = None,
        origins: Sequence[str] = (),
    ) -> None:
        self._application = application
        self._listening = ("", True, Access())
        application.middlewares.insert(0, own_pages_only(lambda: self._listening, origins))
        self._entrance = entrance
        self._acceptor = Acceptor(busy, most)
        watch_connections(application, self._acceptor)
        self._runner: web.AppRunner | None = None

    @property
    def port(self) -> int:
        """The port that is listened on, 0 before `start`."""
        return self._acceptor.port

    async def start(self, host: str, port: int, access: Access, *, allowed: bool) -> None:
        """Start to listen.

        Parameters
        ----------
        host, port
            Where to listen; port 0 takes any free one.
        access
            What clients must present.
        allowed
            Whether clients without a token or certificate may connect.

        Raises
        ------
        InputError
            Anyone could connect although that is not allowed, or a certificate cannot be used.
        MmtError
            The host or the port cannot be used.
        """
        check_listening(host, port, access, self._entrance, allowed=allowed)
        context = access.server_context()
        self._listening = (host, is_loopback(host), access)
        runner = web.AppRunner(
            self._application,
            access_log=None,
            logger=wire_logger(),
            shutdown_timeout=CLOSE_TIMEOUT_S,
            keepalive_timeout=_KEEP_ALIVE_S,
        )
        await runner.setup()
        try:
            guarded = access.authenticates_peer
            await self._acceptor.start(host, port, runner, context, guarded=guarded)
        except OSError as error:
            await runner.cleanup()
            why = str(error.strerror or error).partition(" (while")[0]  # drops the address
            raise MmtError(
                f"cannot listen on {host} port {port} ({why}): "
                f"set {self._entrance.address} to an address of this machine and a free port"
            ) from error
        self._runner = runner

    async def stop(self) -> None:
        """Stop listening; if not started, do nothing."""
        runner, self._runner = self._runner, None
        if runner is not None:
            await self._acceptor.stop()
            await runner.cleanup()


class LinkServer:
    """A Socket.IO server and pages on one port, with the link's transport and bounds.

    Parameters
    ----------
    settings
        Where to listen; port 0 takes any free one.
    access
        What clients must present.
    entrance
        Who connects, for the errors.
    busy, most
        See `Listener`.
    ping_s
        Time between two pings, and longest time for a client's answer (s); None for those of
        the link.
    """

    def __init__(
        self,
        settings: ServedTable,
        access: Access,
        *,
        entrance: Entrance = FOLLOWERS,
        busy: Callable[[], bool] = lambda: False,
        most: int | None = None,
        ping_s: tuple[int, int] | None = None,
    ) -> None:
        self._settings = settings
        self._access = access
        origins = [origin.lower() for origin in settings.allow_origins]
        if origins and access.token is None:
            raise InputError(
                f"[{access.table}] allow_origins: pages of other sites may connect only with a "
                "token: give one by token_file"
            )
        interval_s, timeout_s = ping_s or (PING_INTERVAL_S, PING_TIMEOUT_S)
        self.server = socketio.AsyncServer(
            async_mode="aiohttp",
            serializer=Packet,
            transports=["websocket"],
            async_handlers=False,
            cors_allowed_origins=[],  # `own_pages_only` looks at origins
            max_http_buffer_size=MAX_MESSAGE_BYTES,
            ping_interval=interval_s,
            ping_timeout=timeout_s,
            logger=wire_logger(),
            engineio_logger=wire_logger(),
        )
        self.application = guarded_application(access)
        self.server.attach(self.application)
        self.sockets = ServerSockets(self.server, self.application)
        self._listener = Listener(self.application, entrance, busy, most, origins)

    @property
    def port(self) -> int:
        """The port that is listened on, 0 before `start`."""
        return self._listener.port

    async def start(self, pages: Iterable[Page] = ()) -> None:
        """Start to listen, and serve these pages beside Socket.IO.

        Raises
        ------
        InputError
            Anyone could connect and the scene does not allow it, or a certificate cannot be used.
        MmtError
            The host or the port cannot be used.
        """
        settings = self._settings
        for add_page in pages:
            add_page(self.application, self._access)
        await self._listener.start(
            settings.host, settings.port, self._access, allowed=settings.open
        )

    async def stop(self) -> None:
        """Close all connections and stop listening; if not started, do nothing."""
        if self.port:
            await self.sockets.close(CLOSE_TIMEOUT_S)
            await self.server.shutdown()
            await self._listener.stop()


def health_page(read: Callable[[], Mapping[str, Any]]) -> Page:
    """Return the page ``/health``: 200 if the key ``faults`` is empty, else 503.

    If there is a token, clients without it only see whether all is well.
    """

    def add(application: web.Application, access: Access) -> None:
        async def health(request: web.Request) -> web.Response:
            table = read()
            good = not table["faults"]
            trusted = access.admits_header(request.headers.get("Authorization"))
            content = {"ok": good, **(table if trusted else {})}
            return web.json_response(content, status=200 if good else 503)

        application.router.add_get("/health", health)

    return add


def metrics_page(registry: "CollectorRegistry") -> Page:
    """Return the page ``/metrics``, in OpenMetrics if the client accepts it, else Prometheus' text.

    A thread generates the page, for one request at a time.
    """
    from prometheus_client.exposition import choose_encoder

    def add(application: web.Application, _: Access) -> None:
        one = asyncio.Lock()

        async def metrics(request: web.Request) -> web.Response:
            encode, content_type = choose_encoder(request.headers.get("Accept", ""))
            async with one:
                text = await asyncio.to_thread(encode, registry)
            return web.Response(body=text, headers={"Content-Type": content_type})

        application.router.add_get("/metrics", metrics)

    return add
