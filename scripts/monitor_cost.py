"""What looking on costs the leader's tick: runs with and without viewers, in turns.

Usage: .venv/bin/python scripts/monitor_cost.py [ROUNDS [SECONDS [VIEWERS]]]
"""

import asyncio
import json
import socket
import statistics
import sys
import tempfile
from pathlib import Path

import aiohttp

FIGURES = ("period_p50_ms", "period_p99_ms", "late_share_1ms", "core_share")


def free_port() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


async def look_on(http: aiohttp.ClientSession, port: int) -> int:
    """Take messages until the session ends; return how many came."""
    count = 0
    async with http.ws_connect(f"http://127.0.0.1:{port}/monitor/socket") as viewer:
        await viewer.send_str('{"token": null}')
        async for _ in viewer:
            count += 1
    return count


async def ready(http: aiohttp.ClientSession, port: int) -> None:
    """Wait until the leader answers."""
    while True:
        try:
            async with http.get(f"http://127.0.0.1:{port}/health"):
                return
        except aiohttp.ClientError:
            await asyncio.sleep(0.2)


async def run(seconds: float, viewers: int, folder: Path) -> dict[str, float]:
    """Run the demo's services once; return the leader's figures."""
    port, summary = free_port(), folder / "summary.json"
    module = (sys.executable, "-m", "mmt.cli.entry")
    leading = ("leader", "demo", "--port", str(port), "--duration", str(seconds))
    files = ("--json", str(summary), "--record", str(folder / "session.mcap"))
    shown = ("--monitor",) if viewers else ()
    quiet = asyncio.subprocess.DEVNULL
    leader = await asyncio.create_subprocess_exec(
        *module, *leading, *files, *shown, stdout=quiet, stderr=quiet
    )
    async with aiohttp.ClientSession() as http:
        await ready(http, port)
        looking = [asyncio.create_task(look_on(http, port)) for _ in range(viewers)]
        follower = await asyncio.create_subprocess_exec(
            *module, "follower", "demo", "--leader", f"http://127.0.0.1:{port}",
            stdout=quiet, stderr=quiet,
        )  # fmt: skip
        await leader.wait()
        await follower.wait()
        counts = await asyncio.gather(*looking)
    tables = json.loads(summary.read_text(encoding="utf-8"))
    figures = {**tables["ticks"], **tables["process"]}
    return {name: figures[name] for name in FIGURES} | {"messages": sum(counts)}


async def main(rounds: int = 3, seconds: float = 18.0, viewers: int = 1) -> None:
    """Print each run, then the ratio of the medians."""
    found: dict[bool, list[dict[str, float]]] = {False: [], True: []}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(rounds):
            for watched in (False, True):
                figures = await run(seconds, viewers if watched else 0, Path(folder))
                found[watched].append(figures)
                print("with   " if watched else "without", figures, flush=True)
    for name in FIGURES:
        without, with_ = (statistics.median(f[name] for f in found[w]) for w in (False, True))
        ratio = f"{with_ / without:.2f}" if without else "-"
        print(f"{name}: without {without:.4g}, with {with_:.4g}, ratio {ratio}")


if __name__ == "__main__":
    given = sys.argv[1:]
    kinds = (int, float, int)
    asyncio.run(main(*(kind(value) for kind, value in zip(kinds, given, strict=False))))
