"""The texture player's server: its page, and the page's connection.

The page renders by itself: it receives the models, and each new state of them. The page sends
strokes, which are recorded and timed, and the answers of a participant.
"""

import asyncio
import itertools
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from aiohttp import WSMsgType, web

from mmt.core.errors import InputError, MmtError
from mmt.core.running.ending import start_task
from mmt.link.access import TOKEN_VARIABLE, Access, Entrance
from mmt.link.incoming import RateLimit
from mmt.link.serving.http import Listener
from mmt.web.page_server import add_page, open_socket, pack, page_files
from mmt_share.player.messages import line, parse, steps_of, whole_number
from mmt_share.player.player import Player
from mmt_share.player.study import BEST

_PAGES: Final = Path(__file__).parents[1] / "pages" / "player"
TAKEN_OVER: Final = 4409
"""Close code: another page is connected now."""
_MOST_BYTES: Final = 32_768
_PLAYERS: Final = Entrance(
    "the player",
    "--host and --port",
    f"set a token ({TOKEN_VARIABLE} or --token-file), or allow everyone by --open",
)

_NEWS_S: Final = 0.1
_NEWS_A_STATUS: Final = 10
_MOST_ORDERS: Final = 8
_MESSAGES_HZ: Final = 2.0
"""Rate limit of a page: twenty messages and 40 kB a second; it sends some ten, of 1 kB."""
_FLOODED: Final = 1008
_MOST_HELD_MS: Final = 10_000.0
"""Longest stroke that a slow network may hold back and deliver at once."""
_FASTER: Final = 1.05
"""How much faster than this machine's clock the clock of a page may be."""


class PlayerServer:
    """Serve the page ``/player/``.

    Parameters
    ----------
    player
        The textures and the scenarios.
    access
        What is required of a page that connects.
    several
        Whether several pages may be connected at once; if not, a new page replaces the old one.
    """

    def __init__(
        self, player: Player, access: Access | None = None, *, several: bool = False
    ) -> None:
        self.player = player
        self._several = several
        self._access = access or Access()
        self._connection: PageConnection | None = None
        application = web.Application()
        application.router.add_get("/", self._redirect)
        application.router.add_get("/player/socket", self._receive)
        vendored = {"mmt-texture.js": "texture/mmt-texture.js"}
        add_page(application, "/player", page_files(_PAGES, vendored))
        self._listener = Listener(application, _PLAYERS)

    @property
    def port(self) -> int:
        """Port of the server, 0 before `start`."""
        return self._listener.port

    async def start(self, host: str, port: int, *, everyone: bool = False) -> None:
        """Listen.

        Parameters
        ----------
        host, port
            Address to listen on; port 0 takes any free one.
        everyone
            Whether pages without a token may play.

        Raises
        ------
        InputError
            Anyone could play although that is not allowed, or a certificate cannot be used.
        MmtError
            The host or the port cannot be used.
        """
        await self._listener.start(host, port, self._access, allowed=everyone)

    async def stop(self) -> list[tuple[Path, float]]:
        """Stop listening, and end recordings; return each with its duration in s."""
        if self._connection is not None:
            await self._connection.socket.close()
        await self._listener.stop()
        return self.player.close()

    async def _redirect(self, _: web.Request) -> web.StreamResponse:
        raise web.HTTPFound("/player/")

    async def _receive(self, request: web.Request) -> web.StreamResponse:
        socket, admitted = await open_socket(request, self._access, _MOST_BYTES)
        if not admitted:
            return socket
        connection, earlier = PageConnection(self.player, socket), self._connection
        self._connection = connection
        if earlier is not None and not self._several:
            await earlier.socket.close(code=TAKEN_OVER, message=b"another page plays now")
        try:
            await connection.serve()
        finally:
            if self._connection is connection:
                self._connection = None
        return socket


class PageConnection:
    """Connection of one page, which receives models, and sends strokes and orders.

    Parameters
    ----------
    player
        The textures and the scenarios.
    socket
        The page's WebSocket, open and authorized.
    """

    def __init__(self, player: Player, socket: web.WebSocketResponse) -> None:
        self._player = player
        self.socket = socket
        self._models: tuple[bytes, ...] = ()
        self._hand: tuple[float, float, bool] | None = None
        self._orders: set[asyncio.Task[None]] = set()
        self._order_lock = asyncio.Lock()
        self._shown: dict[str, Any] | None = None
        self._rejected = 0
        self._limit = RateLimit(_MESSAGES_HZ, lambda _: None, lambda _: None)
        self._then_s = time.monotonic()
        self._earned_ms = 1000.0

    async def serve(self) -> None:
        """Handle the page's messages until it disconnects."""
        await self.socket.send_bytes(self._player.hello())
        reporting = asyncio.create_task(self._send_news())
        try:
            async for message in self.socket:
                text = message.type is WSMsgType.TEXT
                if not text or not self._limit.passes(len(message.data), time.monotonic_ns()):
                    await self.socket.close(code=_FLOODED, message=b"too many messages")
                    break
                await self._handle(message.data)
        except ConnectionError:
            pass  # the page has gone
        finally:
            for task in (reporting, *self._orders):
                task.cancel()
            await asyncio.gather(reporting, *self._orders, return_exceptions=True)
            self._player.end_touch()

    async def _handle(self, text: str) -> None:
        message: dict[str, Any] = {}
        try:
            message = parse(text)
            if message["do"] == "stroke":
                self._stroke(message)
            elif len(self._orders) >= _MOST_ORDERS:
                raise InputError("too many orders at once")
            else:
                start_task(self._order(message), self._orders)
        except MmtError as error:
            self._rejected += 1
            await self._answer(message, str(error), good=False)

    def _stroke(self, message: dict[str, Any]) -> None:
        """Take a part of a stroke, or its end if the tile is null."""
        player = self._player
        if message.get("tile") is None:
            player.end_touch()
            return
        tile, steps = whole_number(message, "tile", len(player.names) - 1), steps_of(message)
        now_s = time.monotonic()
        earned_ms = self._earned_ms + _FASTER * 1e3 * (now_s - self._then_s)
        self._earned_ms, self._then_s = min(earned_ms, _MOST_HELD_MS), now_s
        lasted_ms = sum(step.duration_ms for step in steps)
        if lasted_ms > self._earned_ms:
            raise InputError("a stroke cannot be longer than the time that has passed")
        self._earned_ms -= lasted_ms
        player.stroke(tile, steps)

    async def _order(self, message: dict[str, Any]) -> None:
        """Carry out an order and answer it; its rows are on the disk before the answer."""
        good = False
        try:
            async with self._order_lock:
                sentence = await asyncio.to_thread(self._carry_out, message)
            good = True
        except MmtError as error:
            sentence = str(error)
        with suppress(ConnectionError):  # the page has gone meanwhile
            await self._show_study()  # first: the page goes on from this state
            await self._answer(message, sentence, good=good)

    def _carry_out(self, message: dict[str, Any]) -> str:
        player, what, last = self._player, message["do"], len(self._player.names) - 1
        with player.ordering:  # an order goes on although its page has gone
            if what == "begin":
                return player.begin(str(message.get("scenario")), line(message, "participant"))
            if what == "leave":
                return player.end_scenario()
            if player.study is None:
                raise InputError("begin a scenario first")
            if what == "rate":
                return player.study.rate(whole_number(message, "rating", BEST, 1))
            if what == "answer":
                sample, tile = (whole_number(message, name, last) for name in ("sample", "tile"))
                return player.study.answer(sample, tile)
            if what == "finish":
                return player.study.finish()
        raise InputError(f"do is {what!r}: allowed are begin, leave, rate, answer, finish")

    async def _answer(self, message: dict[str, Any], text: str, *, good: bool) -> None:
        number = message.get("id")
        if isinstance(number, int):
            header = {"id": number, "ok": good, "text": text}
            await self.socket.send_bytes(pack("answer", header, {}))

    async def _show_study(self) -> None:
        study = self._player.study
        state = {"scenario": None} if study is None else study.state()
        if state != self._shown:
            self._shown = state
            await self.socket.send_bytes(pack("study", state, {}))

    async def _send_news(self) -> None:
        """Send what has changed, and once a second the status, which keeps the connection alive."""
        player = self._player
        for turn in itertools.count():
            if self._models is not player.model_messages:
                self._models = player.model_messages
                for model in self._models:
                    await self.socket.send_bytes(model)
            await self._show_study()
            if player.hand is not None and player.hand != self._hand:
                self._hand = x_mm, y_mm, touches = player.hand
                hand = {"x_mm": x_mm, "y_mm": y_mm, "touches": touches}
                await self.socket.send_bytes(pack("hand", hand, {}))
            if turn % _NEWS_A_STATUS == 0:
                status = {**player.status(), "rejected": self._rejected}
                await self.socket.send_bytes(pack("status", status, {}))
            await asyncio.sleep(_NEWS_S)
