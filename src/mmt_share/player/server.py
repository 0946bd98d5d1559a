"""The texture player's server: its page, and the page's connection; one page plays at a time."""

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from aiohttp import WSMsgType, web

from mmt.core.errors import InputError, MmtError
from mmt.link.access import TOKEN_VARIABLE, Access, Entrance
from mmt.link.http import Listener
from mmt.web.binary_messages import pack
from mmt.web.page_server import add_page, open_socket, page_files
from mmt_share.player.messages import PlayRequest, line, parse, play_request, whole
from mmt_share.player.motion import PointerMotion
from mmt_share.player.player import Player
from mmt_share.player.stream import FASTEST_HZ, Stream
from mmt_share.player.study import BEST

_PAGES: Final = Path(__file__).parents[1] / "pages" / "player"
TAKEN_OVER: Final = 4409
"""Close code: another page plays now."""
_MOST_BYTES: Final = 32_768
_PLAYERS: Final = Entrance(
    "the player",
    "--host and --port",
    f"set a token ({TOKEN_VARIABLE} or --token-file), or allow everyone by --open",
)

_STATUS_S: Final = 1.0
_MOST_ORDERS: Final = 8
_MOST_MESSAGES: Final = 2000
"""In a second; a page sends some 190."""
_FLOODED: Final = 1008
_SLOWEST_STROKE_MM_S: Final = 5.0


class PlayerServer:
    """Serve the page ``/player/``.

    Parameters
    ----------
    player
        The textures and the scenarios.
    access
        What is required of a page that connects.
    several
        Whether several pages may play at once; otherwise the newest one does.
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
        add_page(application, "/player", page_files(_PAGES, {}))
        self._listener = Listener(application, _PLAYERS)

    @property
    def port(self) -> int:
        """The port that is listened on, 0 before `start`."""
        return self._listener.port

    async def start(self, host: str, port: int, *, everyone: bool = False) -> None:
        """Listen.

        Parameters
        ----------
        host, port
            Where; port 0 takes any free one.
        everyone
            Whether pages without a token may play.

        Raises
        ------
        InputError
            Anyone could play although that is not allowed, or a certificate cannot be used.
        MmtError
            The host or the port cannot be had.
        """
        await self._listener.start(host, port, self._access, allowed=everyone)

    async def stop(self) -> list[tuple[Path, float]]:
        """Stop listening, and end recordings; return each with its seconds."""
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
    """The connection of one page: it asks for samples and sends orders, until it leaves.

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
        self._stream: Stream | None = None
        self._models = player.models
        self._motion = PointerMotion()
        self._orders: set[asyncio.Task[None]] = set()
        self._order_lock = asyncio.Lock()
        self._shown: dict[str, Any] | None = None
        self._rejected = 0
        self._received = 0
        self._since_s = time.monotonic()

    async def serve(self) -> None:
        """Answer the page's messages."""
        await self.socket.send_bytes(self._player.hello())
        await self._show_study()
        reporting = asyncio.create_task(self._send_status())
        try:
            async for message in self.socket:
                if message.type is not WSMsgType.TEXT or self._is_flooding():
                    await self.socket.close(code=_FLOODED, message=b"too many messages")
                    break
                await self._handle(message.data)
        except ConnectionError:
            pass  # the page has gone
        finally:
            for task in (reporting, *self._orders):
                task.cancel()
            await asyncio.gather(reporting, *self._orders, return_exceptions=True)
            self._player.lift()
            if self._stream is not None:
                self._stream.close()

    async def _handle(self, text: str) -> None:
        message: dict[str, Any] = {}
        try:
            message = parse(text)
            if message["do"] == "play":
                await self._play(play_request(message, len(self._player.names)))
            elif message["do"] == "open":
                await self._open(whole(message, "rate_hz", FASTEST_HZ))
            elif len(self._orders) >= _MOST_ORDERS:
                raise InputError("too many orders at once")
            else:
                task = asyncio.create_task(self._order(message))
                self._orders.add(task)
                task.add_done_callback(self._orders.discard)
        except MmtError as error:
            self._rejected += 1
            await self._answer(message, str(error), good=False)

    async def _open(self, rate_hz: int) -> None:
        """Begin the sound, or begin it anew."""
        self._models = self._player.models
        stream = Stream(self._models, rate_hz, seed=self._player.seed)
        if self._stream is not None:
            self._stream.close()
        self._stream = stream
        self._motion.lift()
        self._player.lift()
        header = {"rate_hz": rate_hz, "delay_ms": 1e3 * stream.delay_s}
        await self.socket.send_bytes(pack("opened", header, {}))

    async def _play(self, request: PlayRequest) -> None:
        stream, motion, player = self._stream, self._motion, self._player
        if stream is None:
            raise InputError("open the sound first")
        if self._models is not player.models:
            self._models = player.models
            stream.use(self._models)
        tile = request.tile
        if tile is None:
            motion.lift()
        else:
            motion.follow(request.points, request.now_ms)
        texture = player.texture(tile) if tile is not None and motion.touches else None
        block = stream.next(request, motion, texture)
        if texture is None or tile is None:
            player.lift()
        else:
            player.record(texture, motion, block.vibration_m_s2)
            x_mm_s, y_mm_s = motion.velocity_mm_s
            if x_mm_s**2 + y_mm_s**2 >= _SLOWEST_STROKE_MM_S**2 and player.study is not None:
                player.study.stroked(tile, len(block.sound_m_s2) / stream.rate_hz)
                await self._show_study()
        header = {"number": request.number, "first": stream.sent - len(block.sound_m_s2)}
        await self.socket.send_bytes(pack("sound", header, {"sound": block.sound_m_s2}))

    async def _order(self, message: dict[str, Any]) -> None:
        """Carry out an order; rows are on the disk before it is answered."""
        good = False
        try:
            async with self._order_lock:
                sentence = await asyncio.to_thread(self._order_function(message))
            good = True
        except MmtError as error:
            sentence = str(error)
        with suppress(ConnectionError):  # the page has gone meanwhile
            await self._show_study()  # first, so that the page goes on from there
            await self._answer(message, sentence, good=good)

    def _order_function(self, message: dict[str, Any]) -> Callable[[], str]:
        player, what, last = self._player, message["do"], len(self._player.names) - 1
        if what == "begin":
            scenario, participant = message.get("scenario"), line(message, "participant")
            return lambda: player.begin(str(scenario), participant)
        if what == "leave":
            return player.leave
        if player.study is None:
            raise InputError("begin a scenario first")
        study = player.study
        if what == "rate":
            rating = whole(message, "rating", BEST, 1)
            return lambda: study.rate(rating)
        if what == "answer":
            sample, tile = whole(message, "sample", last), whole(message, "tile", last)
            return lambda: study.answer(sample, tile)
        if what == "finish":
            return study.finish
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

    async def _send_status(self) -> None:
        """Send the status once a second, which also keeps the connection alive."""
        while True:
            status = {**self._player.status(), "rejected": self._rejected}
            await self.socket.send_bytes(pack("status", status, {}))
            await asyncio.sleep(_STATUS_S)

    def _is_flooding(self) -> bool:
        now_s = time.monotonic()
        if now_s - self._since_s >= 1.0:
            self._since_s, self._received = now_s, 0
        self._received += 1
        return self._received > _MOST_MESSAGES
