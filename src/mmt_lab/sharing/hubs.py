"""One session that hubs share with many listeners, and what that takes."""

import asyncio
import json
import os
import shutil
import socket
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import psutil

from mmt.cli.child import KILL, Child, send
from mmt.core.children import python_command
from mmt.core.errors import InputError, MmtError
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.harness.findings import Findings
from mmt_lab.sharing.counting import Count, Counter, auth_of

_SCENE: Final = "demo"
_LATEST_S: Final = 60.0
"""How long anything of this may take beside the session."""
_CROWD: Final = 500
"""Most listeners of one process."""
_MANY: Final = 100_000


@dataclass
class Used:
    """What a hub used while it served.

    Attributes
    ----------
    cpu_s, seconds
        Processor time, and over which time.
    empty_mb, full_mb
        Resident memory before the first listener, and with all of them.
    """

    cpu_s: float
    seconds: float
    empty_mb: float
    full_mb: float


@dataclass
class Session:
    """A session: the leader's summary, its own listener, the hubs and the listeners of all hubs."""

    leader: dict[str, Any]
    direct: Count
    hubs: list[dict[str, Any]]
    used: list[Used]
    counts: list[Count]
    joined_s: float


async def hold(hubs: int, listeners: int, duration_s: float) -> Session:
    """Run Redis, the demo's leader, hubs, their listeners, and then the follower.

    Raises
    ------
    InputError
        There is no redis-server.
    MmtError
        Something did not start.
    """
    async with AsyncExitStack() as stack:
        redis = await stack.enter_async_context(_redis())
        lasting = ["--duration", str(duration_s)]
        leader = await _child(
            stack,
            ["leader", _SCENE, "--json-lines", "--share", "--port", "0", *lasting],
            MMT_SHARING__PORT="0",
        )
        told = leader.lines()
        port = (await _line(leader, told, "ready"))["port"]
        shared = (await _line(leader, told, "event", "shared at "))["event"]
        url = shared.removeprefix("shared at ")
        direct = Counter(url, auth_of(url))
        await direct.join()
        served = [await _hub(stack, url, redis, listeners) for _ in range(hubs)]
        before = [_use(child) for child, _, _ in served]
        crowds, joined_s = await _join(stack, [each[1] for each in served], listeners, duration_s)
        follower = ["follower", _SCENE, "--json-lines", "--leader", f"http://127.0.0.1:{port}"]
        idle = [_use(child) for child, _, _ in served]
        await _child(stack, follower)
        await _line(leader, told, "event", "follower")
        begun_s = asyncio.get_running_loop().time()
        summary = await _line(leader, told, "summary")
        seconds = asyncio.get_running_loop().time() - begun_s
        after = [_use(child) for child, _, _ in served]
        counts = [Count(**each) for crowd in crowds for each in await _printed(crowd)]
        for child, _, _ in served:
            child.interrupt()
        summaries = [await _line(child, lines, "summary") for child, _, lines in served]
        used = [
            Used(end[0] - start[0], seconds, empty[1], end[1])
            for empty, start, end in zip(before, idle, after, strict=True)
        ]
        return Session(summary, await direct.leave(), summaries, used, counts, joined_s)


def findings(hubs: int, listeners: int, duration_s: float) -> Findings:
    """Run a session with hubs; return what it took.

    Raises
    ------
    InputError
        There is no redis-server.
    MmtError
        Something did not start, or no listener has heard a change.
    """
    session = asyncio.run(hold(hubs, listeners, duration_s))
    counts, last = session.counts, session.direct
    lags = [lag for each in counts for lag in each.lags_ms]
    if not lags:
        problems = {each.problem for each in counts} - {""}
        raise MmtError(f"no listener had a change of the model: {' '.join(problems)}")
    same = sum((each.number, each.digest) == (last.number, last.digest) for each in counts)
    seconds = max(each.seconds for each in session.used)
    cpu = sum(each.cpu_s / each.seconds for each in session.used) / listeners
    kilobytes = 1e3 * sum(each.full_mb - each.empty_mb for each in session.used) / listeners
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
        "empty_mb": ("memory of a hub without listeners (MB)", session.used[0].empty_mb),
        "many_cores": (f"for {_MANY} listeners: processors (cores)", cpu * _MANY),
        "many_memory_gb": (f"for {_MANY} listeners: memory (GB)", 1e-6 * kilobytes * _MANY),
        "many_mb_a_second": (f"for {_MANY} listeners: traffic (MB/s)", 1e-6 * rate * _MANY),
    }
    about = (
        f"The demo's scene for {duration_s:g} s, {hubs} hubs and {listeners} listeners that render "
        f"nothing, all on this machine; what {_MANY} take is these figures in proportion."
    )
    return single_figures("Hubs", about, rows)


@asynccontextmanager
async def _redis() -> AsyncIterator[str]:
    """Run a Redis server that keeps nothing on a free port; give its URL."""
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


async def _child(stack: AsyncExitStack, command: list[str], **environment: str) -> Child:
    child = await Child.start(command[0], "mmt.cli.child", command, {**os.environ, **environment})
    stack.push_async_callback(child.kill)
    return child


async def _line(
    child: Child, lines: AsyncIterator[dict[str, Any]], kind: str, beginning: str = ""
) -> dict[str, Any]:
    """Return the next line of a kind, and of an event that begins so."""
    async for line in lines:
        if line["kind"] == kind and str(line.get("event", "")).startswith(beginning):
            return line
    raise MmtError(f"the {child.name} has ended: {child.messages}")


async def _hub(
    stack: AsyncExitStack, url: str, redis: str, most: int
) -> tuple[Child, str, AsyncIterator[dict[str, Any]]]:
    child = await _child(
        stack,
        ["main", "hub", url, "--redis", redis, "--port", "0", "--json-lines"],
        MMT_SHARING__MOST=str(most),
    )
    lines = child.lines()
    return child, (await _line(child, lines, "ready"))["address"], lines


async def _join(
    stack: AsyncExitStack, urls: list[str], listeners: int, duration_s: float
) -> tuple[list[asyncio.subprocess.Process], float]:
    """Let the listeners join, the same number at each hub; return their processes and the time."""
    crowds = []
    for number, url in enumerate(urls):
        there = listeners // len(urls) + (number < listeners % len(urls))
        while there > 0:
            count = min(there, _CROWD)
            there -= count
            crowd = await asyncio.create_subprocess_exec(
                *python_command("-m", "mmt_lab.sharing.counting", url),
                *(str(count), str(duration_s + _LATEST_S)),
                stdout=asyncio.subprocess.PIPE,
                limit=1 << 26,
            )
            stack.callback(send, crowd, KILL)
            crowds.append(crowd)
    joined = [await _printed(crowd) for crowd in crowds]
    return crowds, max(each["joined_s"] for each in joined)


async def _printed(crowd: asyncio.subprocess.Process) -> Any:
    assert crowd.stdout is not None  # noqa: S101 - it was asked for
    line = await crowd.stdout.readline()
    if not line:
        raise MmtError("the listeners' process has ended")
    return json.loads(line)


def _use(child: Child) -> tuple[float, float]:
    """Return the processor time of a process (s) and its memory (MB)."""
    process = psutil.Process(child.pid)
    times = process.cpu_times()
    return times.user + times.system, 1e-6 * process.memory_info().rss
