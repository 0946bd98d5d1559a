"""Measure the link beside a bare WebSocket: latency, processor time, losses, in one run.

Leader and follower are two processes on this machine. Each sends one message a tick, so
that frames go up and commands come down at the same rate. Rounds of the link and of a bare
aiohttp WebSocket, with payloads of the same size, alternate, so that both meet the same
machine. Run it with ``python -m mmt.evaluation.link_bench [SECONDS]``.
"""

import argparse
import asyncio
import multiprocessing
import statistics
import struct
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from multiprocessing.connection import Connection
from typing import Any, Final, Literal

import aiohttp
import numpy as np
from aiohttp import web

from mmt.arrays import RecordArray
from mmt.errors import MmtError
from mmt.frames import CHANNELS, COMMAND_DTYPE, frame_dtype
from mmt.link.client import FollowerClient, FollowerEvents
from mmt.link.protocol import FollowerHello
from mmt.link.server import LeaderEvents, LeaderServer
from mmt.process import prefer_even_ticks
from mmt.scene import Link
from mmt.ticking import Ticker, TimeHistogram

Kind = Literal["ours", "bare"]

_KINDS: Final[tuple[Kind, ...]] = ("ours", "bare")
_FRAME: Final = frame_dtype(CHANNELS)
_HEAD: Final = struct.Struct("<Iq")
_WARM_UP_S: Final = 0.5
_SETTLE_S: Final = 0.3
_PATIENCE_S: Final = 20.0


@dataclass(frozen=True)
class DirectionResult:
    """One direction of one kind of link: medians over the rounds, sums of what went wrong."""

    p50_ms: float
    p99_ms: float
    messages: int
    lost: int
    out_of_order: int


@dataclass(frozen=True)
class KindResult:
    """One kind of link; the processor time is in cores, median over the rounds."""

    up: DirectionResult
    """Frames, follower to leader."""
    down: DirectionResult
    """Commands, leader to follower."""
    leader_cores: float
    follower_cores: float


@dataclass(frozen=True)
class LinkBenchResult:
    """What `bench_link` measured; ``ratios`` are ours over bare."""

    duration_s: float
    rate_hz: int
    rounds: int
    ours: KindResult
    bare: KindResult

    @property
    def ratios(self) -> dict[str, float]:
        """Ours over bare, by what was measured."""
        ours, bare = self.ours, self.bare
        return {
            "up_p50": ours.up.p50_ms / bare.up.p50_ms,
            "up_p99": ours.up.p99_ms / bare.up.p99_ms,
            "down_p50": ours.down.p50_ms / bare.down.p50_ms,
            "down_p99": ours.down.p99_ms / bare.down.p99_ms,
            "leader_cores": ours.leader_cores / bare.leader_cores,
            "follower_cores": ours.follower_cores / bare.follower_cores,
        }

    def as_dict(self) -> dict[str, Any]:
        """Return everything for a program."""
        return {**asdict(self), "ratios": self.ratios}


def bench_link(duration_s: float, rate_hz: int = 1000, *, rounds: int = 3) -> LinkBenchResult:
    """Measure the link and a bare WebSocket in alternating rounds.

    Parameters
    ----------
    duration_s
        How long each of the two is measured, over all rounds.
    rate_hz
        Messages a second each way.
    rounds
        How often the two take turns.

    Raises
    ------
    MmtError
        A process of the measurement failed.
    """
    sides: dict[Kind, list[tuple[_Side, _Side]]] = {kind: [] for kind in _KINDS}
    for _ in range(rounds):
        for kind in _KINDS:
            sides[kind].append(_run_round(kind, duration_s / rounds, rate_hz))
    return LinkBenchResult(
        duration_s, rate_hz, rounds, _summarise(sides["ours"]), _summarise(sides["bare"])
    )


@dataclass
class _Side:
    """What one process sends, receives and costs."""

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
        block = np.zeros(elapsed, dtype=self.layout)
        block["sequence"] = np.arange(self.sent, self.sent + elapsed)
        block["time_ns"] = time.monotonic_ns()
        self.sent += elapsed
        return block

    def take(self, data: bytes) -> None:
        sequence, time_ns = _HEAD.unpack_from(data)
        self.latency.add(time.monotonic_ns() - time_ns)
        self.received += 1
        if sequence <= self.newest:
            self.out_of_order += 1
        self.newest = sequence

    def take_block(self, block: RecordArray, _arrival_ns: int) -> None:
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
        self.p50_ms = self.latency.quantile_ms(0.5) or 0.0
        self.p99_ms = self.latency.quantile_ms(0.99) or 0.0
        await asyncio.sleep(_SETTLE_S)
        ticker.stop()
        await ticker.wait()
        await asyncio.sleep(_SETTLE_S)


async def _our_leader(side: _Side, pipe: Connection, rate_hz: int, duration_s: float) -> None:
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
    await asyncio.wait_for(ended.wait(), _PATIENCE_S)
    await server.stop()


async def _our_follower(side: _Side, port: int, rate_hz: int, duration_s: float) -> None:
    client = FollowerClient(
        f"http://127.0.0.1:{port}",
        FollowerHello(channels=CHANNELS, source="bench", rate_hz=rate_hz),
        FollowerEvents(on_commands=side.take_block),
    )
    await client.connect(_PATIENCE_S)
    await side.stream(client.send_frames, rate_hz, duration_s)
    await client.end("measured")
    await client.disconnect()


async def _bare(
    side: _Side,
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


async def _bare_leader(side: _Side, pipe: Connection, rate_hz: int, duration_s: float) -> None:
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


async def _bare_follower(side: _Side, port: int, rate_hz: int, duration_s: float) -> None:
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"http://127.0.0.1:{port}/") as websocket,
    ):
        await _bare(side, websocket, rate_hz, duration_s)


def _lead(kind: Kind, pipe: Connection, rate_hz: int, duration_s: float) -> None:
    side = _Side(COMMAND_DTYPE)
    leader = _our_leader if kind == "ours" else _bare_leader
    asyncio.run(leader(side, pipe, rate_hz, duration_s))
    pipe.send(side)


def _follow(kind: Kind, pipe: Connection, rate_hz: int, duration_s: float) -> None:
    side = _Side(_FRAME)
    follower = _our_follower if kind == "ours" else _bare_follower
    asyncio.run(follower(side, pipe.recv(), rate_hz, duration_s))
    pipe.send(side)


def _run_round(kind: Kind, duration_s: float, rate_hz: int) -> tuple[_Side, _Side]:
    """Measure one kind once; return the leader's and the follower's side."""
    context = multiprocessing.get_context("spawn")
    leader, leader_end = context.Pipe()
    follower, follower_end = context.Pipe()
    processes = [
        context.Process(target=_lead, args=(kind, leader_end, rate_hz, duration_s)),
        context.Process(target=_follow, args=(kind, follower_end, rate_hz, duration_s)),
    ]
    for process in processes:
        process.start()
    leader_end.close()
    follower_end.close()
    try:
        follower.send(_receive(leader, _PATIENCE_S))
        return (
            _receive(leader, duration_s + 2 * _PATIENCE_S),
            _receive(follower, duration_s + 2 * _PATIENCE_S),
        )
    finally:
        for process in processes:
            process.join(1.0)
            process.terminate()
            process.join()
            process.close()
        leader.close()
        follower.close()


def _receive(pipe: Connection, timeout_s: float) -> Any:
    if not pipe.poll(timeout_s):
        raise MmtError(f"a process of the link's measurement gave nothing in {timeout_s:g} s")
    try:
        return pipe.recv()
    except EOFError as error:
        raise MmtError("a process of the link's measurement failed") from error


def _summarise(rounds: list[tuple[_Side, _Side]]) -> KindResult:
    return KindResult(
        up=_direction([(follower, leader) for leader, follower in rounds]),
        down=_direction(rounds),
        leader_cores=statistics.median(leader.cores for leader, _ in rounds),
        follower_cores=statistics.median(follower.cores for _, follower in rounds),
    )


def _direction(rounds: list[tuple[_Side, _Side]]) -> DirectionResult:
    """Summarise the way from the first of each pair to the second."""
    return DirectionResult(
        p50_ms=statistics.median(to.p50_ms for _, to in rounds),
        p99_ms=statistics.median(to.p99_ms for _, to in rounds),
        messages=sum(to.received for _, to in rounds),
        lost=sum(of.sent - to.received for of, to in rounds),
        out_of_order=sum(to.out_of_order for _, to in rounds),
    )


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seconds", nargs="?", type=float, default=60.0)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    result = bench_link(given.seconds, rounds=given.rounds)
    print(f"{'':6}{'up p50/p99 ms':>16}{'down p50/p99 ms':>18}{'cores':>14}  lost  out of order")
    for kind, of in (("ours", result.ours), ("bare", result.bare)):
        print(
            f"{kind:6}{of.up.p50_ms:>9.3f}/{of.up.p99_ms:.3f}{of.down.p50_ms:>12.3f}/"
            f"{of.down.p99_ms:.3f}{of.leader_cores:>9.2f}/{of.follower_cores:.2f}"
            f"{of.up.lost + of.down.lost:>6}{of.up.out_of_order + of.down.out_of_order:>14}"
        )
    print("ratio ", ", ".join(f"{name} {ratio:.2f}" for name, ratio in result.ratios.items()))


if __name__ == "__main__":
    main()
