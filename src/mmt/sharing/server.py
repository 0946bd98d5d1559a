"""The server of a shared model: Socket.IO for listeners, on a port of its own."""

import asyncio
import logging
import time
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from typing import Any, Final

import socketio
from aiohttp import web

from mmt.core.errors import InputError, MmtError
from mmt.core.logs import RepeatLimit
from mmt.link.access import Access, check_listening
from mmt.link.http import CLOSE_TIMEOUT_S, guarded_application, make_server
from mmt.link.http import Listener as HttpListener
from mmt.link.protocol import MAX_SENTENCE, PING_TIMEOUT_S, peer_text
from mmt.link.rate_limit import RateLimit
from mmt.link.websocket import Send, ServerSockets
from mmt.scene.sharing_tables import Sharing
from mmt.sharing.messages import AGAIN, SHARING_VERSION, TOKEN_VARIABLE, WELCOME, Hello
from mmt.sharing.relay import Listener, Relay
from mmt.sharing.store import ModelStore
from mmt.sharing.store_pages import store_pages

LOG: Final = logging.getLogger("mmt.sharing")

SHARING_KEYS: Final = (
    f"set a token ({TOKEN_VARIABLE}, or token_file of [sharing]), or certificates "
    "(certificate, key and authority of [sharing]), or allow it by open = true of [sharing]"
)
_REFUSED: Final = (
    "the token is missing or wrong: give the listener the leader's token, "
    f"in {TOKEN_VARIABLE} or token_file of [listening]"
)
_MESSAGES_HZ: Final = 1.0
"""A listener may send ten messages a second, of 20 kB in all: it has little to say."""


class SharingServer:
    """Serve a relay's messages to listeners.

    Parameters
    ----------
    settings
        The scene's ``[sharing]``; port 0 takes any free one.
    relay
        Has the messages.
    welcome
        What a listener is told first: ``session_id``, ``name`` and ``rate_hz`` of the session.
    on_change
        Called when a listener has come or gone, with a sentence and how many there are.

    Raises
    ------
    InputError
        The token cannot be read.
    """

    def __init__(
        self,
        settings: Sharing,
        relay: Relay,
        welcome: Mapping[str, Any],
        on_change: Callable[[str, int], None],
    ) -> None:
        self._settings = settings
        self._access = Access.of(settings, variable=TOKEN_VARIABLE)
        self._relay = relay
        self._welcome = {"sharing": SHARING_VERSION, **welcome}
        self._on_change = on_change
        self._names: dict[str, str] = {}
        self._joined_s: dict[str, float] = {}
        self.listened_s = 0.0
        """Seconds that all listeners have listened, together, but for those who still do."""
        self._sends: dict[str, Send] = {}
        self._serving: dict[str, asyncio.Task[None]] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._refusals = RepeatLimit()
        self._server = make_server(PING_TIMEOUT_S)
        self._server.on("connect", self._on_connect)
        self._server.on("disconnect", self._on_disconnect)
        self._server.on(AGAIN, self._on_again)
        application = guarded_application(self._access)
        self._server.attach(application)
        application.router.add_get("/", _explain)
        if settings.store is not None:
            store_pages(ModelStore(settings.store), accepts=settings.accept)(
                application, self._access
            )
        self._sockets = ServerSockets(self._server, application)
        self._listener = HttpListener(
            application, "host and port of [sharing]", most=2 * settings.most
        )

    @property
    def port(self) -> int:
        """The port that is listened on, 0 before `start`."""
        return self._listener.port

    async def start(self) -> None:
        """Listen.

        Raises
        ------
        InputError
            Anyone could listen and the scene does not allow it, or a certificate cannot be used.
        MmtError
            The host or the port cannot be used.
        """
        settings = self._settings
        check_listening(
            settings.host,
            settings.port,
            self._access,
            allowed=settings.open,
            role="a listener",
            remedy=SHARING_KEYS,
        )
        await self._listener.start(settings.host, settings.port, self._access, allowed=True)

    async def stop(self) -> None:
        """Let every listener have its last messages, within a second, and close."""
        if self._serving:
            _, late = await asyncio.wait(self._serving.values(), timeout=CLOSE_TIMEOUT_S)
            for task in late:
                task.cancel()
        for sid in list(self._names):
            self._on_disconnect(sid, "the session is over")
        if self.port:
            await self._sockets.close(CLOSE_TIMEOUT_S)
            await self._server.shutdown()
            await self._listener.stop()

    def _admit(self, auth: object) -> Hello:
        """Return the hello of a listener that may connect.

        Raises
        ------
        MmtError
            It may not; the message is for its user.
        """
        if not self._access.admits(auth.get("token") if isinstance(auth, dict) else None):
            raise MmtError(_REFUSED)
        hello = Hello.from_auth(auth)
        if len(self._names) >= self._settings.most:
            raise InputError(
                f"{self._settings.most} are listening already: raise most of [sharing], or wait"
            )
        return hello

    def _on_connect(self, sid: str, environ: Mapping[str, object], auth: object = None) -> None:
        try:
            hello = self._admit(auth)
        except MmtError as error:
            times = self._refusals.allow("refusal")
            if times:
                LOG.warning("refused a listener: %s", peer_text(str(error), MAX_SENTENCE))
            raise socketio.exceptions.ConnectionRefusedError(str(error)) from error
        self._names[sid] = hello.name
        self._joined_s[sid] = time.monotonic()
        limit = RateLimit(_MESSAGES_HZ, lambda _: None, lambda _: None)
        self._sockets.admit(environ, {}, limit)
        self._sends[sid] = self._sockets.send(sid, environ)
        self._start(self._server.emit(WELCOME, self._welcome, to=sid))
        self._tell(hello.name, "joined")

    def _on_disconnect(self, sid: str, _: str) -> None:
        name = self._names.pop(sid, None)
        if sid in self._joined_s:
            self.listened_s += time.monotonic() - self._joined_s.pop(sid)
        self._sends.pop(sid, None)
        self._relay.listeners.pop(sid, None)
        task = self._serving.pop(sid, None)
        if task is not None:
            task.cancel()
        if name is not None:
            self._tell(name, "left")

    def _on_again(self, sid: str, *_: object) -> None:
        listener, send = self._relay.listeners.get(sid), self._sends.get(sid)
        if listener is not None:
            listener.again()
        elif send is not None:
            listener = self._relay.listeners[sid] = Listener(self._relay)
            self._serving[sid] = self._start(self._serve(sid, listener, send))

    async def _serve(self, sid: str, listener: Listener, send: Send) -> None:
        with suppress(ConnectionError):
            try:
                await listener.serve(send)
            except TimeoutError:
                LOG.warning("a listener has stalled and is let go")
                await self._server.disconnect(sid)

    def _start(self, coroutine: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def _tell(self, name: str, what: str) -> None:
        count = len(self._names)
        who = f"listener {name}" if name else "a listener"
        self._on_change(f"{who} {what}, {count} listening", count)


async def _explain(_: web.Request) -> web.Response:
    return web.Response(text="A texture model is shared here: mmt-listen with this address.\n")
