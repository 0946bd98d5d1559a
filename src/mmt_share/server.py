"""The server of a shared model: Socket.IO for listeners, on a port of its own."""

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import socketio
from aiohttp import web

from mmt.core.errors import InputError, MmtError
from mmt.core.output.logs import RepeatLimit
from mmt.core.running.ending import start_task
from mmt.core.running.process import release_freed_memory
from mmt.link.access import Access, Entrance
from mmt.link.incoming import RateLimit
from mmt.link.protocol import MAX_SENTENCE, loss_of, peer_text
from mmt.link.serving.http import CLOSE_TIMEOUT_S, LinkServer, Page
from mmt_share.lag import ListenerState
from mmt_share.messages import (
    AGAIN,
    HAVE,
    HUBS,
    PING_S,
    SHARING_VERSION,
    TOKEN_VARIABLE,
    WELCOME,
    Hello,
)
from mmt_share.relay import STALLED_S, ConnectedListener, ListenerFeed, Relay
from mmt_share.tables import Sharing

if TYPE_CHECKING:
    from mmt_share.operators import Operators


class FullError(InputError):
    """The server has as many listeners as it may have."""


LOG: Final = logging.getLogger("mmt_share")

_LISTENERS: Final = Entrance.of_table("a listener", "sharing", TOKEN_VARIABLE)
_REFUSED: Final = (
    "the token is missing or wrong: give the listener the leader's token, "
    f"in {TOKEN_VARIABLE} or token_file of [listening]"
)
_NO_CONTROL: Final = (
    "no control is given to this listener: the leader's scene needs [control], and the listener "
    "the leader's token for it, in MMT_CONTROL_TOKEN or token_file of [operating]"
)
_MESSAGES_HZ: Final = 1.0
"""Rate limit of a listener: ten messages and 20 kB a second."""

_RELEASE_PERIOD_S: Final = 60.0
_MOST_SHOWN: Final = 30
"""Listeners whose figures are reported every second: those with the largest lag."""


class SharingServer:
    """Serve a relay's messages to listeners.

    Parameters
    ----------
    settings
        The scene's ``[sharing]``; port 0 takes any free one.
    relay
        Holds the messages.
    welcome
        First message to a listener: ``session_id``, ``name`` and ``rate_hz`` of the session.
    on_change
        Called when a listener joins or leaves, with a sentence and details: ``kind``, "listener
        joined" or "listener left"; the number of ``listeners``; and the ``listener``.

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
        on_change: Callable[[str, dict[str, Any]], None],
    ) -> None:
        self._settings = settings
        self._access = Access.from_settings(settings, variable=TOKEN_VARIABLE, table="sharing")
        self._relay = relay
        self._welcome = {"sharing": SHARING_VERSION, **welcome}
        self._on_change = on_change
        self._connected: dict[str, ConnectedListener] = {}
        self._joined = 0
        self.listened_s = 0.0
        """Total time (s) that past listeners were connected."""
        self._tasks: set[asyncio.Task[None]] = set()
        self._releasing: asyncio.Task[None] | None = None
        self._refusals = RepeatLimit()
        self._pages = _pages(settings)
        self._host = LinkServer(
            settings,
            self._access,
            entrance=_LISTENERS,
            most=2 * settings.most,
            ping_s=PING_S,
        )
        self._host.server.on("connect", self._on_connect)
        self._host.server.on("disconnect", self._on_disconnect)
        self._host.server.on(AGAIN, self._on_again)
        self._host.server.on(HAVE, self._on_have)
        self.operators: Operators | None = None
        """Listeners that may ask for control, or None if none may."""

    def admit_operators(self, token: Access, tell: Callable[..., None]) -> None:
        """Let listeners with this token ask for control; see `Operators`."""
        from mmt_share.operators import Operators

        self.operators = Operators(self._host.server, token, tell)

    @property
    def port(self) -> int:
        """Port of the server, 0 before `start`."""
        return self._host.port

    async def start(self) -> None:
        """Listen; see `LinkServer.start` for the errors."""
        await self._host.start(self._pages)
        self._releasing = start_task(_release(), self._tasks)

    async def stop(self) -> None:
        """Send every listener its last messages, for at most a second, and close."""
        serving = [each.serving for each in self._connected.values() if each.serving is not None]
        if serving:
            _, late = await asyncio.wait(serving, timeout=CLOSE_TIMEOUT_S)
            for task in late:
                task.cancel()
        for sid in list(self._connected):
            self._on_disconnect(sid, "the session is over")
        if self._releasing is not None:
            self._releasing.cancel()
        await self._host.stop()

    async def welcome(self, **changed: object) -> None:
        """Send every listener the welcome again, with these entries changed."""
        self._welcome.update(changed)
        await self._host.server.emit(WELCOME, self._welcome)

    async def send_hubs(self, addresses: list[str]) -> None:
        """Send every listener the addresses of the other hubs."""
        self._welcome[HUBS] = addresses
        await self._host.server.emit(HUBS, addresses)

    def figures(self) -> dict[str, Any]:
        """Return the totals of all listeners, and ``rows`` for the 30 with the largest lag."""
        everyone = self._connected.values()
        known = {each.number: ms for each in everyone if (ms := each.feed.lag.last_ms) is not None}
        behind = sorted(everyone, key=lambda each: known.get(each.number, -1.0), reverse=True)
        lags = sorted(known.values())
        return {
            "listeners": len(everyone),
            "joined": self._joined,
            "sent": dict(self._relay.sent),
            "lag_median_ms": lags[len(lags) // 2] if lags else None,
            "lag_most_ms": lags[-1] if lags else None,
            "rows": [each.figures() for each in behind[:_MOST_SHOWN]],
        }

    def _admit(self, auth: object) -> Hello:
        """Check the ``auth`` of a listener, and return its hello.

        Raises
        ------
        MmtError
            The listener may not connect; the message is for its user.
        """
        if not self._access.admits(auth.get("token") if isinstance(auth, dict) else None):
            raise MmtError(_REFUSED)
        hello = Hello.from_auth(auth)
        if hello.operates:
            token = auth.get("control_token") if isinstance(auth, dict) else None
            if self.operators is None or not self.operators.access.admits(token):
                raise MmtError(_NO_CONTROL)
        if len(self._connected) >= self._settings.most:
            raise FullError(
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
            elsewhere = self._welcome.get(HUBS) if isinstance(error, FullError) else None
            data = [{HUBS: elsewhere}] if elsewhere else []
            raise socketio.exceptions.ConnectionRefusedError(str(error), *data) from error
        self._joined += 1
        operators = self.operators if hello.operates else None
        name = hello.name if operators is None else operators.distinct(hello.name, self._joined)
        listener = self._connected[sid] = ConnectedListener(
            self._joined,
            name,
            self._host.sockets.send(sid, environ),
            ListenerFeed(self._relay, hello.states_hz),
        )

        def on_exceeded(error: MmtError) -> None:
            listener.why = str(error)

        messages_hz = _MESSAGES_HZ
        handlers: dict[str, Callable[[bytes], None]] = {HAVE: partial(self._on_have, sid)}
        if operators is not None:
            handlers |= operators.join(sid, listener)
            messages_hz += operators.messages_hz
        limit = RateLimit(messages_hz, listener.reject, on_exceeded)
        self._host.sockets.admit(environ, handlers, limit)
        start_task(self._host.server.emit(WELCOME, self._welcome, to=sid), self._tasks)
        who = {"id": listener.number, "name": listener.name}
        self._report_change(f"{listener.text} joined", "listener joined", **who)

    def _on_disconnect(self, sid: str, reason: str) -> None:
        listener = self._connected.pop(sid, None)
        if listener is None:
            return
        figures = listener.figures()
        self.listened_s += figures["listened_s"]
        self._relay.listeners.pop(sid, None)
        if self.operators is not None:
            self.operators.leave(sid)
        if listener.serving is not None:
            listener.serving.cancel()
        why = listener.why or loss_of(reason)
        text = f"{listener.text} left after {figures['listened_s']:.0f} s ({why})"
        self._report_change(text, "listener left", why=why, **figures)

    def _on_again(self, sid: str, *_: object) -> None:
        listener = self._connected.get(sid)
        if listener is None:
            return
        listener.feed.restart()
        if listener.serving is None:
            self._relay.listeners[sid] = listener.feed
            listener.serving = start_task(self._serve(sid, listener), self._tasks)

    def _on_have(self, sid: str, data: object = None, *_: object) -> None:
        listener = self._connected.get(sid)
        if listener is None:
            return
        try:
            listener.feed.record_answer(ListenerState.unpack(data), time.monotonic_ns())
        except InputError as error:
            listener.reject(str(error))

    async def _serve(self, sid: str, listener: ConnectedListener) -> None:
        with suppress(ConnectionError):
            try:
                await listener.feed.serve(listener.send)
            except TimeoutError:
                LOG.warning("a listener has stalled and is let go")
                listener.why = f"it took nothing for {STALLED_S:g} s"
                await self._host.server.disconnect(sid)
                return
        listener.serving = None  # the end was sent; the listener may ask again
        self._relay.listeners.pop(sid, None)

    def _report_change(self, text: str, kind: str, **listener: object) -> None:
        count = len(self._connected)
        details = {"kind": kind, "listeners": count, "listener": listener}
        self._on_change(f"{text}, {count} listening", details)


async def _release() -> None:
    """Free the memory of past listeners once a minute; it would add up over hours."""
    await asyncio.sleep(_RELEASE_PERIOD_S)
    while release_freed_memory():
        await asyncio.sleep(_RELEASE_PERIOD_S)


def _pages(settings: Sharing) -> list[Page]:
    pages: list[Page] = [_front_page]
    if settings.store is not None:  # needs the compiled numerics
        from mmt_share.store.pages import store_pages
        from mmt_share.store.store import ModelStore

        pages.append(store_pages(ModelStore(settings.store), accepts=settings.accept))
    return pages


def _front_page(application: web.Application, _: Access) -> None:
    application.router.add_get("/", _explain)


async def _explain(_: web.Request) -> web.Response:
    return web.Response(text="A texture model is shared here: mmt-listen with this address.\n")
