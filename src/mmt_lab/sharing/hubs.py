"""One session that hubs share with many listeners, and its cost."""

import asyncio
import shutil
import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import psutil

from mmt.cli.running.child import KILL, send
from mmt.core.errors import InputError, MmtError
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.harness.findings import Findings
from mmt_lab.harness.processes import received
from mmt_lab.sharing.counting import CountingListener, ListenerCounts, auth_of, count
from mmt_lab.sharing.session import Service, shared_session, start_service

_LATEST_S: Final = 60.0
"""How long Redis may take to start, and listeners beyond the session."""
_CROWD: Final = 500
"""Most listeners of one process."""
_MANY: Final = 100_000


@dataclass
class HubSession:
    """Results of a session: the leader's own listener, the hubs, and all listeners of hubs.

    ``cpu_s`` is the hubs' processor time in the ``seconds`` of the session, ``memory_mb`` their
    memory for listeners, ``empty_mb`` that of the first one without any.
    """

    direct: ListenerCounts
    hubs: list[dict[str, Any]]
    counts: list[ListenerCounts]
    joined_s: float
    seconds: float
    cpu_s: float
    memory_mb: float
    empty_mb: float


async def run_hub_session(hubs: int, listeners: int, duration_s: float) -> HubSession:
    """Run Redis, a leader, hubs, their listeners, and then the follower."""
    async with _redis() as redis, shared_session(duration_s) as session:
        direct = CountingListener(session.url, auth_of(session.url))
        await direct.join()
        command = "main", "hub", session.url, "--redis", redis, "--port", "0"
        most = {"MMT_SHARING__MOST": str(listeners)}
        served = [
            await start_service(session.stack, *command, environment=most) for _ in range(hubs)
        ]
        urls = [(await hub.line("ready"))["address"] for hub in served]
        before = [_use(hub) for hub in served]
        longest_s = duration_s + _LATEST_S
        crowds = session.listen(*_calls(urls, listeners, longest_s))
        joined_s = max([await asyncio.to_thread(received, one, longest_s) for one in crowds])
        idle = [_use(hub) for hub in served]
        await session.start_follower()
        await session.leader.line("event", "^follower")
        begun_s = asyncio.get_running_loop().time()
        await session.leader.line("summary")
        seconds = asyncio.get_running_loop().time() - begun_s
        after = [_use(hub) for hub in served]
        found = [await asyncio.to_thread(received, one, longest_s) for one in crowds]
        counts = [each for crowd in found for each in crowd]
        for hub in served:
            hub.child.interrupt()
        summaries = [await hub.line("summary") for hub in served]
        cpu_s, memory_mb = np.sum(after, 0) - (np.sum(idle, 0)[0], np.sum(before, 0)[1])
        own = await direct.leave()
        return HubSession(own, summaries, counts, joined_s, seconds, cpu_s, memory_mb, before[0][1])


def findings(hubs: int, listeners: int, duration_s: float) -> Findings:
    """Run a session with hubs; return its cost as findings."""
    session = asyncio.run(run_hub_session(hubs, listeners, duration_s))
    counts, last = session.counts, session.direct
    lags = [lag for each in counts for lag in each.lags_ms]
    if not lags:
        problems = {each.problem for each in counts} - {""}
        raise MmtError(f"no listener had a change of the model: {' '.join(problems)}")
    same = sum((each.number, each.digest) == (last.number, last.digest) for each in counts)
    seconds = session.seconds
    cpu = session.cpu_s / seconds / listeners
    kilobytes = 1e3 * session.memory_mb / listeners
    sent = [each["sent"] for each in session.hubs]
    kinds = ("wholes", "changes", "states")
    rate = sum(each[f"{kind}_bytes"] for each in sent for kind in kinds) / listeners / seconds
    lag_50, lag_99 = np.percentile(lags, [50, 99]).tolist()
    rows: dict[str, Figure] = {
        "listeners": ("listeners", len(counts) - sum(bool(each.problem) for each in counts)),
        "same": ("of them with the leader's last model", same, "at least", listeners),
        "models": ("states of the model", last.number),
        "rejected": ("messages that did not fit", sum(e.rejected for e in counts), "at most", 0),
        "lag_p50_ms": ("from the leader's state to the listener's, p50 (ms)", lag_50),
        "lag_p99_ms": ("the same, p99 (ms)", lag_99, "at most", 1000.0),
        "states_hz": (
            "states of the hand to each (1/s)",
            sum(each.states for each in counts) / listeners / seconds,
        ),
        "joined_s": ("until all had joined (s)", session.joined_s),
        "cpu_ms_a_second": ("hubs' processor time for each listener (ms/s)", 1e3 * cpu),
        "bytes_a_second": ("to each listener (bytes/s)", rate),
        "memory_kb": ("hubs' memory for each listener (kB)", kilobytes),
        "empty_mb": ("memory of a hub without listeners (MB)", session.empty_mb),
        "many_cores": (f"for {_MANY} listeners: processors (cores)", cpu * _MANY),
        "many_memory_gb": (f"for {_MANY} listeners: memory (GB)", 1e-6 * kilobytes * _MANY),
        "many_mb_a_second": (f"for {_MANY} listeners: traffic (MB/s)", 1e-6 * rate * _MANY),
    }
    about = (
        f"A rough texture for {duration_s:g} s, {hubs} hubs and {listeners} listeners that render "
        f"nothing, all on this machine; what {_MANY} take is these figures in proportion."
    )
    return single_figures("Hubs", about, rows)


@asynccontextmanager
async def _redis() -> AsyncIterator[str]:
    """Run a Redis server without persistence on a free port; yield its URL."""
    program = shutil.which("redis-server")
    if program is None:
        raise InputError("redis-server is not installed: apt install redis-server")
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]
    process = await asyncio.create_subprocess_exec(
        *(program, "--port", str(port), "--bind", "127.0.0.1", "--save", "", "--appendonly", "no"),
        stdout=asyncio.subprocess.DEVNULL,
    )
    try:
        async with asyncio.timeout(_LATEST_S):
            while True:
                with suppress(OSError):
                    _, writer = await asyncio.open_connection("127.0.0.1", port)
                    writer.close()
                    break
                await asyncio.sleep(0.05)
        yield f"redis://127.0.0.1:{port}"
    finally:
        send(process, KILL)
        await process.wait()


def _calls(urls: list[str], listeners: int, longest_s: float) -> Iterator[tuple[Any, ...]]:
    """Yield the processes of the listeners, of whom each hub has the same number."""
    for number, url in enumerate(urls):
        there = listeners // len(urls) + (number < listeners % len(urls))
        for first in range(0, there, _CROWD):
            yield count, url, longest_s, min(there - first, _CROWD)


def _use(hub: Service) -> tuple[float, float]:
    """Return the processor time of a process (s) and its memory (MB)."""
    process = psutil.Process(hub.child.pid)
    times = process.cpu_times()
    return times.user + times.system, 1e-6 * process.memory_info().rss
