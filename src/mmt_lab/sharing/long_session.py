"""Long sessions with listeners that join and leave, vanish, stall, and send rubbish."""

import asyncio
import random
import time
from collections import Counter
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Final, Literal

import aiohttp
import numpy as np
import psutil
import socketio

from mmt.core.errors import MmtError
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.harness.findings import Findings
from mmt_lab.harness.processes import leave_process_session
from mmt_lab.harness.proxy import Proxy
from mmt_lab.sharing.crowd import join_apart
from mmt_lab.sharing.session import run_with_listeners
from mmt_lab.soak.drift import Drift, by_window, drift
from mmt_share.client import ListenerClient
from mmt_share.messages import SHARING_VERSION
from mmt_share.tables import Listening

STEADY: Final = 5
"""Listeners that stay."""
EVERY_S: Final = 2.0
"""Time from one trouble to the next."""
_STALL_S: Final = 14.0
"""Length of a stall, longer than the leader waits for a listener that reads nothing."""

KINDS: Final = {
    "visits": "listeners that came and left",
    "vanished": "connections cut without a goodbye",
    "stalled": "listeners that took nothing for 14 s",
    "rubbish": "clients that sent what makes no sense",
}
"""Kinds of trouble, with their descriptions."""


class TroubledListeners:
    """The troubles of one run."""

    def __init__(self, url: str, seed: int) -> None:
        self._url, self._target = url, int(url.rpartition(":")[2])
        self._random = random.Random(seed)  # noqa: S311 - no secret
        self._ended = asyncio.Event()
        self.counts: Counter[str] = Counter()

    async def run(self, longest_s: float) -> dict[str, Any]:
        """Make troubles until the end; return counts of each, and of steady ones up to date."""
        asyncio.get_running_loop().call_later(longest_s, self._ended.set)
        steady = [await self._joined(self._url) for _ in range(STEADY)]
        troubles: set[asyncio.Task[None]] = set()
        while not self._ended.is_set():
            kind = self._random.choice(list(KINDS))
            task = asyncio.create_task(self.make(kind))
            troubles.add(task)
            task.add_done_callback(troubles.discard)
            with suppress(TimeoutError):
                await asyncio.wait_for(self._ended.wait(), EVERY_S)
        for task in list(troubles):
            task.cancel()
        await asyncio.gather(*troubles, return_exceptions=True)
        for client in steady:
            await client.close()
        newest = max(client.replica.number for client in steady)
        same = sum(client.replica.number == newest > 0 for client in steady)
        return {"steady": same, **{kind: self.counts[kind] for kind in KINDS}}

    async def make(self, kind: str) -> None:
        """Make one of `KINDS`, and wait until it is over."""
        makers = {
            "visits": self._visit,
            "vanished": self._vanish,
            "stalled": self._stall,
            "rubbish": self._send_rubbish,
        }
        with suppress(MmtError, socketio.exceptions.SocketIOError):  # the session may have ended
            self.counts[kind] += 1
            await makers[kind]()

    def _hear(self, text: str) -> None:
        if "has ended" in text:
            self._ended.set()

    async def _joined(self, url: str) -> ListenerClient:
        client = ListenerClient(Listening(url=url), on_event=self._hear)
        try:
            await client.connect()
        except BaseException:
            await client.close()
            raise
        return client

    async def _visit(self) -> None:
        client = await self._joined(self._url)
        try:
            await asyncio.sleep(self._random.uniform(0.1, 10.0))
        finally:
            await client.close()

    async def _vanish(self) -> None:
        async with Proxy(self._target) as proxy:
            client = await self._joined(f"http://127.0.0.1:{proxy.port}")
            try:
                await asyncio.sleep(self._random.uniform(0.1, 5.0))
                proxy.cut()
            finally:
                await client.close()

    async def _stall(self) -> None:
        async with Proxy(self._target) as proxy:
            client = await self._joined(f"http://127.0.0.1:{proxy.port}")
            try:
                proxy.stall()
                await asyncio.sleep(_STALL_S)
            finally:
                proxy.cut()
                await client.close()

    async def _send_rubbish(self) -> None:
        # the library's own HTTP session stays open if connecting fails or leaving is cut short
        async with aiohttp.ClientSession() as http:
            await self._send_garbage(
                socketio.AsyncClient(serializer="msgpack", reconnection=False, http_session=http)
            )

    async def _send_garbage(self, client: socketio.AsyncClient) -> None:
        hello = {"sharing": SHARING_VERSION, "role": "listener", "name": "rubbish"}
        await client.connect(self._url, auth=hello, transports=["websocket"])
        try:
            for _ in range(2000):
                event = self._random.choice(["again", "have", "frames", ""])
                await client.emit(event, self._random.randbytes(self._random.randrange(5000)))
                if not client.connected:
                    break
                await asyncio.sleep(0.002)
        finally:
            await client.disconnect()


async def make_trouble(pipe: Connection, url: str, longest_s: float, seed: int) -> None:
    """Make troubles until the end of the session or of a time, and send the number of each."""
    leave_process_session()
    pipe.send(await TroubledListeners(url, seed).run(longest_s))


_LARGEST_GROWTH_MB: Final = 1.0
_SAMPLE_S: Final = 1.0
_SETTLED_SHARE: Final = 0.3
"""Share of the run that is ignored at first: the model still grows, and memory pools fill."""

Who = Literal["leader", "sharing"]


class Memory:
    """Samples of resident memory, one per second."""

    def __init__(self) -> None:
        self._seen: dict[Who, list[tuple[float, float]]] = {"leader": [], "sharing": []}
        self._due_s = 0.0

    def sample(self, pid: int) -> None:
        """Note the memory of the leader with this process id, and of its sharing process."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + _SAMPLE_S
        try:
            leader = psutil.Process(pid)
            self.add("leader", now_s, leader.memory_info().rss / 1e6)
            for child in leader.children():
                if "mmt_share.process" in child.cmdline():
                    self.add("sharing", now_s, child.memory_info().rss / 1e6)
        except psutil.Error:
            return  # the process has just ended

    def add(self, who: Who, time_s: float, memory_mb: float) -> None:
        """Note the memory of a process."""
        self._seen[who].append((time_s, memory_mb))

    def growth(self, who: Who) -> Drift:
        """Return the drift of a process's memory after the first 30 % of the run."""
        seen = np.array(self._seen[who]).reshape(-1, 2)
        times_s, values = seen[int(_SETTLED_SHARE * len(seen)) :].T
        window_s = max(1.0, np.ptp(times_s) / 20.0) if len(times_s) else 1.0
        return drift(*by_window(times_s, values, window_s, np.median))


def run_long_session(duration_s: float, seed: int) -> Findings:
    """Run a long session with listeners that make trouble, and one without any."""
    alone_s = min(60.0, duration_s)
    alone, _ = asyncio.run(run_with_listeners(alone_s, (join_apart, 1), 1))
    memory = Memory()
    troubled = (make_trouble, seed)
    leader, found = asyncio.run(run_with_listeners(duration_s, troubled, STEADY, memory.sample))
    sharing = leader["sharing"]
    rows: dict[str, Figure] = {
        "tick_p99_ratio": (
            "leader's tick, p99, over that with one quiet listener",
            leader["ticks"]["period_p99_ms"] / alone["ticks"]["period_p99_ms"],
            "at most",
            1.1,
        ),
        "frames_lost": ("frames that the leader lost", leader["link"]["lost"], "at most", 0),
        "completed": ("the session completed", leader["outcome"] == "completed", "at least", 1),
        "steady": ("steady listeners with the last state", found["steady"], "at least", STEADY),
        "joined": ("listeners that joined", sharing["joined"]),
        **{kind: (text, found[kind]) for kind, text in KINDS.items()},
    }
    for who in ("leader", "sharing"):
        grown = memory.growth(who)
        rows[f"{who}_mb"] = (f"memory of the {who} process (MB)", grown.typical)
        rows[f"{who}_growth_mb"] = (
            f"its growth, lower end of 95 % (MB in {grown.span_s:.0f} s)",
            grown.least_growth,
            "at most",
            _LARGEST_GROWTH_MB,
        )
        slope = None if grown.growth is None else 3600.0 * grown.growth / grown.span_s
        rows[f"{who}_slope_mb_h"] = (f"slope of the {who} process (MB/h)", slope)
    about = (
        f"A rough texture for {duration_s / 60.0:g} min, {STEADY} listeners that stay, and others "
        f"that make trouble every {EVERY_S:g} s; memory after the first 30 %."
    )
    return single_figures("Sharing for long", about, rows)
