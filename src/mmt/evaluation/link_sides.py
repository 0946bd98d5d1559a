"""The two processes of the link's measurement: each sends, receives and costs."""

import asyncio
import math
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Final, Literal

import aiohttp
import numpy as np
from aiohttp import web

from mmt.arrays import RecordArray
from mmt.frames import CHANNELS, COMMAND_DTYPE, frame_dtype
from mmt.link.client import FollowerClient, FollowerEvents
from mmt.link.protocol import FollowerHello
from mmt.link.server import LeaderEvents, LeaderServer
from mmt.process import prefer_even_ticks
from mmt.scene import Link
from mmt.ticking import Ticker, TimeHistogram

Kind = Literal["ours", "bare"]

PATIENCE_S: Final = 20.0
"""How long one process waits for the other."""

_FRAME: Final = frame_dtype(CHANNELS)
_HEAD: Final = struct.Struct("<Iq")
_WARM_UP_S: Final = 0.5
_SETTLE_S: Final = 0.3


@dataclass
class Side:
    """What one process sends, receives and costs.

    Parameters
    ----------
    layout
        Dtype of what it sends.
    """

    layout: np.dtype[np.void]
    sent: int = 0
    received: int = 0
    out_of_order: int = 0
    newest: int = -1
    latency: TimeHistogram = field(default_factory=TimeHistogram)
    p50_ms: float = 0.0
    p99_ms: float = 0.0
    cores: float = 0.0

    def next_block(self, elapsed: int) -> RecordArray:
        """Return the records that fall due."""
        block = np.zeros(elapsed, dtype=self.layout)
        block["sequence"] = np.arange(self.sent, self.sent + elapsed)
        block["time_ns"] = time.monotonic_ns()
        self.sent += elapsed
        return block

    def take(self, data: bytes) -> None:
        """Count and time one record that arrived."""
        sequence, time_ns = _HEAD.unpack_from(data)
        self.latency.add(time.monotonic_ns() - time_ns)
        self.received += 1
        if sequence <= self.newest:
            self.out_of_order += 1
        self.newest = sequence

    def take_block(self, block: RecordArray, _arrival_ns: int) -> None:
        """Count and time what the link hands over, its checks included."""
        data = block.tobytes()
        for start in range(0, len(data), block.itemsize):
            self.take(data[start : start + block.itemsize])

    async def stream(
        self, send: Callable[[RecordArray], None], rate_hz: int, duration_s: float
    ) -> None:
        """Send a block a tick, and measure after a while of warming up."""
        prefer_even_ticks()
        ticker = Ticker(round(1e9 / rate_hz), lambda elapsed: send(self.next_block(elapsed)))
        ticker.start()
        await asyncio.sleep(_WARM_UP_S)
        self.latency = TimeHistogram()
        wall_s, busy_s = time.perf_counter(), time.process_time()
        await asyncio.sleep(duration_s)
        self.cores = (time.process_time() - busy_s) / (time.perf_counter() - wall_s)
        self.p50_ms = self.latency.quantile_ms(0.5) or math.nan
        self.p99_ms = self.latency.quantile_ms(0.99) or math.nan
        await asyncio.sleep(_SETTLE_S)
        ticker.stop()
        await ticker.wait()
        await asyncio.sleep(_SETTLE_S)


async def _our_leader(side: Side, pipe: Connection, rate_hz: int, duration_s: float) -> None:
    streaming, ended = asyncio.Event(), asyncio.Event()

    def take(block: RecordArray, arrival_ns: int) -> None:
        side.take_block(block, arrival_ns)
        streaming.set()

    events = LeaderEvents(on_frames=take, on_end=lambda _: ended.set())
    server = LeaderServer(Link(port=0), CHANNELS, events, rate_hz=rate_hz)
    await server.start()
    pipe.send(server.port)
    await streaming.wait()
    await side.stream(server.send_commands, rate_hz, duration_s)
    await asyncio.wait_for(ended.wait(), PATIENCE_S)
    await server.stop()


async def _our_follower(side: Side, port: int, rate_hz: int, duration_s: float) -> None:
    client = FollowerClient(
        f"http://127.0.0.1:{port}",
        FollowerHello(channels=CHANNELS, source="bench", rate_hz=rate_hz),
        FollowerEvents(on_commands=side.take_block),
    )
    await client.connect(PATIENCE_S)
    await side.stream(client.send_frames, rate_hz, duration_s)
    await client.end("measured")
    await client.disconnect()


async def _bare(
    side: Side,
    websocket: web.WebSocketResponse | aiohttp.ClientWebSocketResponse,
    rate_hz: int,
    duration_s: float,
) -> None:
    """Do the same with nothing but a WebSocket, a queue and two tasks."""
    queue: asyncio.Queue[bytes] = asyncio.Queue()

    async def send() -> None:
        while True:
            await websocket.send_bytes(await queue.get())

    async def receive() -> None:
        async for message in websocket:
            side.take(message.data)

    def put(block: RecordArray) -> None:
        for record in block:
            queue.put_nowait(record.tobytes())

    tasks = [asyncio.create_task(send()), asyncio.create_task(receive())]
    await side.stream(put, rate_hz, duration_s)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _bare_leader(side: Side, pipe: Connection, rate_hz: int, duration_s: float) -> None:
    done = asyncio.Event()

    async def handle(request: web.Request) -> web.WebSocketResponse:
        websocket = web.WebSocketResponse()
        await websocket.prepare(request)
        await _bare(side, websocket, rate_hz, duration_s)
        done.set()
        return websocket

    application = web.Application()
    application.router.add_get("/", handle)
    runner = web.AppRunner(application, access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    pipe.send(runner.addresses[0][1])
    await done.wait()
    await runner.cleanup()


async def _bare_follower(side: Side, port: int, rate_hz: int, duration_s: float) -> None:
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"http://127.0.0.1:{port}/") as websocket,
    ):
        await _bare(side, websocket, rate_hz, duration_s)


def lead(kind: Kind, pipe: Connection, rate_hz: int, duration_s: float) -> None:
    """Be the leader: send the port, run, and send what was measured."""
    side = Side(COMMAND_DTYPE)
    leader = _our_leader if kind == "ours" else _bare_leader
    asyncio.run(leader(side, pipe, rate_hz, duration_s))
    pipe.send(side)


def follow(kind: Kind, pipe: Connection, rate_hz: int, duration_s: float) -> None:
    """Be the follower: receive the port, run, and send what was measured."""
    side = Side(_FRAME)
    follower = _our_follower if kind == "ours" else _bare_follower
    asyncio.run(follower(side, pipe.recv(), rate_hz, duration_s))
    pipe.send(side)
