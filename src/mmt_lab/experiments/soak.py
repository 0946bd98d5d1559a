"""Long runs of both services with faults, and the checks that must hold afterwards.

Leader and follower of the demo's scene run as processes, joined by a proxy and an emulated
network. Faults are drawn from a seed: connections cut and stalled, processes paused and killed,
bad networks. Afterwards the recording is read back, and memory, latency and late ticks are tested
for drift.
"""

import asyncio
import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Final

import aiohttp
import typer
from rich.progress import BarColumn, Progress, TextColumn

from mmt.cli.common import messages, stop_on_signals
from mmt.core.errors import InputError, naming
from mmt.core.files.existing import free_path
from mmt_lab.harness.experiment import Seed
from mmt_lab.harness.findings import Findings
from mmt_lab.soak import faults as kinds
from mmt_lab.soak.faults import SoakFault, plan_faults
from mmt_lab.soak.judging import RECOVERY_S, AppliedFault, Check, SoakLog, judge, read_back, table
from mmt_lab.soak.services import SoakServices

SHOWS: Final = "whether services that are disturbed for long lose frames, leak or slow down"
TAKES: Final = "1 h"

_HTTP_S: Final = 20.0


def run(
    duration: Annotated[float, typer.Option(min=5, max=86_000, help="Seconds.")] = 3600.0,
    every: Annotated[
        float, typer.Option(min=1, max=3600, help="Mean seconds from one fault to the next.")
    ] = 20.0,
    seed: Seed = 1,
    output: Annotated[Path, typer.Option(help="Where the recording goes.")] = Path("mmt-soak"),
) -> Findings:
    """Run both services for a long time with faults; check for losses, leaks and slowing down."""
    if os.name != "posix":
        raise InputError("the soak pauses processes by signals: it needs Linux or macOS")
    with naming(f"--output {output}"):
        output.mkdir(parents=True, exist_ok=True)
    recording = free_path(output / "soak.mcap")
    observed = asyncio.run(_run(duration, plan_faults(duration, every, seed), seed, recording))
    checks = judge(observed, read_back(recording), min(RECOVERY_S, 0.4 * every))
    broken = [
        f"{check.what}: {check.found}; allowed: {check.allowed or 'nothing else'}"
        for check in checks
        if not check.held
    ]
    return Findings(
        "Both services with faults",
        tables=[table(checks)],
        sentences=[f"{len(observed.faults)} faults; recording: {recording}"],
        data=_content(observed, checks, seed),
        failures=broken,
    )


def _content(observed: SoakLog, checks: Sequence[Check], seed: int) -> dict[str, Any]:
    """Return all results as a dictionary for JSON."""
    return {
        "duration_s": round(observed.end_s - observed.start_s, 3),
        "seed": seed,
        "faults": [
            {
                "kind": happened.fault.kind,
                "start_s": round(happened.start_s - observed.start_s, 3),
                "length_s": round(happened.end_s - happened.start_s, 3),
            }
            for happened in observed.faults
        ],
        "checks": [asdict(check) for check in checks],
        "leader": observed.leader,
    }


async def _run(
    duration_s: float, faults: tuple[SoakFault, ...], seed: int, recording: Path
) -> SoakLog:
    """Run until the time is over, a service ends by itself, or the user stops the run."""
    progress = Progress(
        TextColumn("{task.fields[status]}"), BarColumn(None), console=messages, expand=True
    )
    bar = progress.add_task("soak", total=duration_s, status="starting")

    def show(status: dict[str, Any]) -> None:
        text = f"{status['time_s']:7.1f} s  faults {len(log.faults)} of {len(faults)}"
        progress.update(
            bar,
            completed=status["time_s"],
            status=f"{text}  {status['phase']:9}  lost {status['frames_lost']}",
        )

    services = SoakServices(recording, seed, show)
    log = services.log
    with progress:
        async with services:
            log.start_s = time.monotonic()
            stop_on_signals(services.ended.set)
            say = progress.console.print
            harming = asyncio.create_task(_harm(services, faults, say))
            with suppress(TimeoutError):
                async with asyncio.timeout(duration_s):
                    await services.ended.wait()
            log.end_s = time.monotonic()
            harming.cancel()
            await asyncio.gather(harming, return_exceptions=True)
            await services.finish()
    return log


async def _harm(
    services: SoakServices, faults: Sequence[SoakFault], say: Callable[[str], None]
) -> None:
    """Apply the faults one after the other, each at its time, and note when they happened."""
    log, timeout = services.log, aiohttp.ClientTimeout(total=_HTTP_S)
    async with aiohttp.ClientSession(timeout=timeout) as http:
        for fault in faults:
            await asyncio.sleep(max(0.0, log.start_s + fault.at_s - time.monotonic()))
            say(f"{fault.at_s:7.1f} s  {fault.kind}, {fault.length_s:.2f} s")
            begun_s = time.monotonic()
            try:
                await _do(fault, services, http)
            except (aiohttp.ClientError, TimeoutError, OSError) as error:
                log.errors.append(f"{fault.kind} could not be done: {error!r}")
            log.faults.append(AppliedFault(fault, begun_s, time.monotonic()))


async def _do(fault: SoakFault, services: SoakServices, http: aiohttp.ClientSession) -> None:
    """Apply one fault from its beginning to its end."""
    if fault.kind == kinds.CUT:
        services.proxy.cut()
    elif fault.kind == kinds.STALL:
        services.proxy.stall()
        await asyncio.sleep(fault.length_s)
        services.proxy.resume()
    elif fault.kind in {kinds.PAUSE_LEADER, kinds.PAUSE_FOLLOWER}:
        await services.pause(fault.kind == kinds.PAUSE_LEADER, fault.length_s)
    elif fault.kind == kinds.RESTART:
        await services.restart_follower(fault.length_s)
    else:
        url = f"http://127.0.0.1:{services.port}/network"
        for settings in (kinds.NETWORKS[fault.kind], {}):
            async with http.put(url, json=settings) as answer:
                answer.raise_for_status()
            await asyncio.sleep(fault.length_s if settings else 0.0)
