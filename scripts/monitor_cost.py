"""Measure what viewers of the monitor cost the leader's tick: runs with and without, in turns.

Usage, after ./scripts/demo has set up .venv:
.venv/bin/python scripts/monitor_cost.py [ROUNDS [SECONDS [VIEWERS]]]

Three rounds of 18 s with two viewers take some two and a half minutes. A table in Markdown goes to
stdout, each run as it ends to stderr.
"""

import asyncio
import statistics
import sys

import aiohttp

from mmt_lab.experiments.bench.services import run_demo_services

FIGURES = {
    "period_p50_ms": "tick period, 50th percentile (ms)",
    "period_p99_ms": "tick period, 99th percentile (ms)",
    "late_share_1ms": "share of ticks over 1 ms late",
    "missed_share": "share of ticks missed",
    "core_share": "share of a core",
}


async def look_on(http: aiohttp.ClientSession, url: str) -> int:
    """Receive messages until the session ends; return their number."""
    count = 0
    async with http.ws_connect(f"{url}/monitor/socket") as viewer:
        await viewer.send_str('{"token": null}')
        async for _ in viewer:
            count += 1
    return count


async def run(seconds: float, viewers: int) -> dict[str, float]:
    """Run the demo's services once; return the leader's figures."""
    looking: list[asyncio.Task[int]] = []
    async with aiohttp.ClientSession() as http:

        def look(url: str) -> None:
            looking.extend(asyncio.create_task(look_on(http, url)) for _ in range(viewers))

        shown = ["monitor"] if viewers else []
        leader = (await run_demo_services(seconds, tables=shown, on_link=look)).leader
        counts = await asyncio.gather(*looking)
    figures = {**leader["ticks"], **leader["process"]}
    figures["missed_share"] = figures["missed"] / figures["ticks"]
    return {name: figures[name] for name in FIGURES} | {"messages": sum(counts)}


async def main(rounds: int = 3, seconds: float = 18.0, viewers: int = 2) -> None:
    """Run in turns, then print the table."""
    found: dict[bool, list[dict[str, float]]] = {False: [], True: []}
    for number in range(rounds):
        # the order alternates, so that warming up favours neither
        for watched in (False, True) if number % 2 == 0 else (True, False):
            figures = await run(seconds, viewers if watched else 0)
            found[watched].append(figures)
            print("with   " if watched else "without", figures, file=sys.stderr, flush=True)
    messages = statistics.median(f["messages"] for f in found[True]) / viewers / seconds
    print(f"{rounds} pairs of {seconds:g} s; {viewers} viewers, {messages:.0f} messages/s each\n")
    print("| figure | without (median, range) | with (median, range) | with - without, by pair |")
    print("| --- | --- | --- | --- |")
    for name, title in FIGURES.items():
        without, with_ = ([f[name] for f in found[watched]] for watched in (False, True))
        pairs = [b - a for a, b in zip(without, with_, strict=True)]
        differences = ", ".join(f"{difference:+.2g}" for difference in pairs)
        print(f"| {title} | {spread(without)} | {spread(with_)} | {differences} |")


def spread(values: list[float]) -> str:
    """Return median, lowest and highest."""
    return f"{statistics.median(values):.3g} ({min(values):.3g} to {max(values):.3g})"


if __name__ == "__main__":
    given = sys.argv[1:]
    kinds = (int, float, int)
    asyncio.run(main(*(kind(value) for kind, value in zip(kinds, given, strict=False))))
