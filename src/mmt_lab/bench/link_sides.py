"""The two processes of the link's measurement; each keeps both links open at the same time.

Each process has a pipe to the measuring process. The leader sends the ports of mmt's link and of
the bare WebSocket, both processes report that they are connected, both receive their turns, and
both send their figures.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Final

import aiohttp
from aiohttp import web

from mmt.core.arrays import RecordArray
from mmt.core.frames import CHANNELS, COMMAND_DTYPE
from mmt.core.running.process import be_real_time, prefer_even_ticks
from mmt.link.client import FollowerClient
from mmt.link.endpoint import FollowerEvents, LeaderEvents
from mmt.link.protocol import FollowerHello
from mmt.link.server import LeaderServer
from mmt.scene import Link
from mmt_lab.bench.link_traffic import Kind, Send, Side, Turn, TurnFigures, run_turn

PATIENCE_S: Final = 60.0
"""How long one process waits for the other."""


@dataclass(frozen=True)
class SideReport:
    """Figures of one process: those of each turn, and totals by link."""

    turns: list[TurnFigures]
    sent: dict[Kind, int]
    newest: dict[Kind, int]
    """Highest sequence number received."""


async def lead(pipe: Connection, rate_hz: int, samples_per_frame: int, realtime: bool) -> None:
    """Run the leader of both links."""
    ours, bare = Side(COMMAND_DTYPE, leads=True), Side(COMMAND_DTYPE, leads=True)
    connected, ended = asyncio.Event(), asyncio.Event()
    events = LeaderEvents(
        on_frames=ours.record_block,
        on_follower=lambda _: connected.set(),
        on_end=lambda _: ended.set(),
    )
    server = LeaderServer(
        Link(port=0), CHANNELS, events, rate_hz=rate_hz, samples_per_frame=samples_per_frame
    )
    await server.start()
    async with _bare_server() as (port, websocket):
        pipe.send((server.port, port))
        await asyncio.wait_for(connected.wait(), PATIENCE_S)
        async with _bare_traffic(bare, await asyncio.wait_for(websocket, PATIENCE_S)) as put:
            await _report(
                pipe,
                {"ours": ours, "bare": bare},
                {"ours": server.send_commands, "bare": put},
                realtime,
            )
            await asyncio.wait_for(ended.wait(), PATIENCE_S)
    await server.stop()


async def follow(pipe: Connection, rate_hz: int, samples_per_frame: int, realtime: bool) -> None:
    """Run the follower of both links."""
    port, bare_port = await asyncio.to_thread(pipe.recv)
    hello = FollowerHello(
        channels=CHANNELS, source="bench", rate_hz=rate_hz, samples_per_frame=samples_per_frame
    )
    ours, bare = Side(hello.frame_dtype), Side(hello.frame_dtype)
    client = FollowerClient(
        f"http://127.0.0.1:{port}",
        hello,
        FollowerEvents(on_commands=ours.record_block),
    )
    await client.connect(PATIENCE_S)
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"http://127.0.0.1:{bare_port}/") as websocket,
        _bare_traffic(bare, websocket) as put,
    ):
        await _report(
            pipe,
            {"ours": ours, "bare": bare},
            {"ours": client.send_frames, "bare": put},
            realtime,
        )
        await client.end("measured")
    await client.disconnect()


async def _report(
    pipe: Connection, sides: dict[Kind, Side], send: dict[Kind, Send], realtime: bool
) -> None:
    """Report that both links are connected, run the turns received, and send the figures."""
    prefer_even_ticks()
    if realtime:
        be_real_time()
    pipe.send("ready")
    turns: list[Turn] = await asyncio.to_thread(pipe.recv)
    measured = [await run_turn(turn, sides[turn.kind], send[turn.kind]) for turn in turns]
    pipe.send(
        SideReport(
            measured,
            {kind: side.sent for kind, side in sides.items()},
            {kind: side.newest for kind, side in sides.items()},
        )
    )


@asynccontextmanager
async def _bare_server() -> AsyncIterator[tuple[int, "asyncio.Future[web.WebSocketResponse]"]]:
    """Serve one bare WebSocket; yield its port, and a future that gives the WebSocket."""
    opened: asyncio.Future[web.WebSocketResponse] = asyncio.get_running_loop().create_future()
    done = asyncio.Event()

    async def handle(request: web.Request) -> web.WebSocketResponse:
        websocket = web.WebSocketResponse()
        await websocket.prepare(request)
        opened.set_result(websocket)
        await done.wait()
        return websocket

    application = web.Application()
    application.router.add_get("/", handle)
    runner = web.AppRunner(application, access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    try:
        yield runner.addresses[0][1], opened
    finally:
        done.set()
        await runner.cleanup()


@asynccontextmanager
async def _bare_traffic(
    side: Side, websocket: web.WebSocketResponse | aiohttp.ClientWebSocketResponse
) -> AsyncIterator[Send]:
    """Send and receive with nothing but a WebSocket, a queue and two tasks."""
    queue: asyncio.Queue[bytes] = asyncio.Queue()

    async def send() -> None:
        while True:
            await websocket.send_bytes(await queue.get())

    async def receive() -> None:
        async for message in websocket:
            side.record(message.data)

    def put(record: RecordArray) -> None:
        queue.put_nowait(record.tobytes())

    tasks = [asyncio.create_task(send()), asyncio.create_task(receive())]
    try:
        yield put
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
