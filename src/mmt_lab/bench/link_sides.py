"""Traffic over both links at the same time, and the two processes that send and measure it.

Each process has a pipe to the measuring process. The leader sends the ports of mmt's link and of
the bare WebSocket, both processes report that they are connected, both receive their turns, and
both send their figures.
"""

import asyncio
import math
import struct
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Final, Literal

import aiohttp
import numpy as np
from aiohttp import web

from mmt.core.arrays import RecordArray
from mmt.core.frames import CHANNELS, COMMAND_DTYPE
from mmt.core.running.process import be_real_time, prefer_even_ticks
from mmt.core.running.ticking import Ticker, TimeHistogram
from mmt.link.client import FollowerClient
from mmt.link.endpoint import FollowerEvents, LeaderEvents
from mmt.link.protocol import FollowerHello
from mmt.link.server import LeaderServer
from mmt.scene import Link

Kind = Literal["ours", "bare"]

WARM_UP_S: Final = 0.1
"""Time for which a turn sends before it measures."""
SETTLE_S: Final = 0.1
"""Pause after a turn, in which the last messages arrive."""

_SLEEP_GRAIN_NS: Final = 2_000_000
_HEAD: Final = struct.Struct("<Iq")


@dataclass(frozen=True)
class Turn:
    """A period in which one link sends one record per message both ways, at a steady rate."""

    kind: Kind
    rate_hz: int
    start_ns: int
    """On the machine's monotonic clock, which both processes read."""
    duration_s: float
    """Length of the measurement, after a short warm-up."""
    leader_lag: float = 0.0
    """Lag of the leader's ticks behind the follower's, as a share of the period."""

    @property
    def end_ns(self) -> int:
        """When the next turn may start."""
        return self.start_ns + round((WARM_UP_S + self.duration_s + SETTLE_S) * 1e9)


@dataclass(frozen=True)
class TurnFigures:
    """Figures of one turn in one process, or of several turns in one direction."""

    kind: Kind
    p50_ms: float
    """One-way latency of the messages received; NaN if there were none."""
    p99_ms: float
    rate_hz: float
    """Messages received per second."""
    cores: float
    """Processor time over elapsed time."""
    lost: int
    """Sequence numbers that are missing between the messages received."""
    out_of_order: int

    @property
    def wrong(self) -> int:
        """Number of messages lost or out of order."""
        return self.lost + self.out_of_order


@dataclass
class Side:
    """Counters of the records that one process sends and receives over one link."""

    layout: np.dtype[np.void]
    leads: bool = False
    sent: int = 0
    lost: int = 0
    out_of_order: int = 0
    newest: int = -1
    latency: TimeHistogram = field(default_factory=TimeHistogram)

    def next_record(self) -> RecordArray:
        """Return the next record, shape (1,)."""
        block = np.zeros(1, dtype=self.layout)
        block["sequence"] = self.sent
        block["time_ns"] = time.monotonic_ns()
        self.sent += 1
        return block

    def record(self, data: bytes, offset: int = 0) -> None:
        """Count and time one record that arrived."""
        sequence, time_ns = _HEAD.unpack_from(data, offset)
        self.latency.add(time.monotonic_ns() - time_ns)
        if sequence <= self.newest:
            self.out_of_order += 1
            return
        self.lost += sequence - self.newest - 1
        self.newest = sequence

    def record_block(self, block: RecordArray, _arrival_ns: int) -> None:
        """Count and time a block that mmt's link delivers, after the checks of the link."""
        data = block.tobytes()
        for offset in range(0, len(data), block.itemsize):
            self.record(data, offset)


Send = Callable[[RecordArray], None]

Links = Mapping[Kind, tuple[Side, Send]]
"""Counters of each kind of link, and what sends a record over it."""


async def run_turn(turn: Turn, side: Side, send: Send) -> TurnFigures:
    """Run a turn over its link, and return its figures."""
    lost, out_of_order = side.lost, side.out_of_order

    def tick(elapsed: int) -> None:
        for _ in range(elapsed):
            send(side.next_record())

    period_ns = round(1e9 / turn.rate_hz)
    ticker = Ticker(period_ns, tick, statistics=False)
    start_ns = turn.start_ns + (round(turn.leader_lag * period_ns) if side.leads else 0)
    await _sleep_until(start_ns - _SLEEP_GRAIN_NS)
    while time.monotonic_ns() < start_ns:
        pass  # a sleep is not exact enough to keep the lag
    ticker.start()
    await _sleep_until(turn.start_ns + round(WARM_UP_S * 1e9))
    side.latency = TimeHistogram()
    wall_s, busy_s = time.perf_counter(), time.process_time()
    await asyncio.sleep(turn.duration_s)
    busy_s, wall_s = time.process_time() - busy_s, time.perf_counter() - wall_s
    latency, side.latency = side.latency, TimeHistogram()
    ticker.stop()
    await ticker.wait()
    await _sleep_until(turn.end_ns)
    quantiles_ms = (latency.quantile_ms(part) for part in (0.5, 0.99))
    p50_ms, p99_ms = (math.nan if each is None else each for each in quantiles_ms)
    rate_hz, cores = latency.count / wall_s, busy_s / wall_s
    counts = side.lost - lost, side.out_of_order - out_of_order
    return TurnFigures(turn.kind, p50_ms, p99_ms, rate_hz, cores, *counts)


async def _sleep_until(time_ns: int) -> None:
    await asyncio.sleep(max(0, time_ns - time.monotonic_ns()) / 1e9)


PATIENCE_S: Final = 60.0
"""How long one process waits for the other."""


@dataclass(frozen=True)
class SideReport:
    """Figures of one process: those of each turn, and totals of mmt's link."""

    turns: list[TurnFigures]
    sent: int
    newest: int
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
            links: Links = {"ours": (ours, server.send_commands), "bare": (bare, put)}
            await _report(pipe, links, realtime)
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
        links: Links = {"ours": (ours, client.send_frames), "bare": (bare, put)}
        await _report(pipe, links, realtime)
        await client.end("measured")
    await client.disconnect()


async def _report(pipe: Connection, links: Links, realtime: bool) -> None:
    """Report that both links are connected, run the turns received, and send the figures."""
    prefer_even_ticks()
    if realtime:
        be_real_time()
    pipe.send("ready")
    turns: list[Turn] = await asyncio.to_thread(pipe.recv)
    measured = [await run_turn(turn, *links[turn.kind]) for turn in turns]
    ours, _ = links["ours"]
    pipe.send(SideReport(measured, ours.sent, ours.newest))


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
