"""Both services as processes: ticks, losses and cost, also with real-time scheduling or strangers.

With ``--realtime`` they run with and without real-time scheduling. With ``--strangers`` they run
beside clients without the token that keep the leader's port busy, and beside a busy bystander.
"""

import asyncio
import os
import secrets
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

from mmt.cli.running.scene_services import DemoRun, run_services
from mmt.core.errors import InputError, MmtError
from mmt.core.frames import check_acceleration_rate
from mmt.core.running.process import require_real_time
from mmt.evaluation.run_verdict import median_of_known
from mmt.scene.files import load_scene
from mmt_lab.bench import strangers as disturbing
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.harness.experiment import AccelerationRate, Duration, RealTime, Strangers
from mmt_lab.harness.findings import Findings, FindingsTable
from mmt_lab.harness.processes import background_processes

SHOWS: Final = "what leader and follower cost, and how late their ticks are"
TAKES: Final = "1 min"
GROUP: Final = "bench"

ROUND_S: Final = 5.0
"""Longest run of the services; the ways to run them take turns."""

_FEW_LATE: Final = 0.001
"""Share of late ticks that is always allowed: one in a second."""

_ALONE: Final = "alone"

_MOST_LATE: Final = {"p99_ms": 1.0, "p99_more_ms": 0.3, "share_1ms_more": 0.003}
"""Targets of ticks while modelling, on a machine that is otherwise quiet."""

_FIGURES: Final = (
    ("leader", "ticks", "period_p99_ms", "leader's tick, p99 period (ms)"),
    ("leader", "ticks", "late_share_1ms", "leader's ticks over 1 ms late, share"),
    ("follower", "ticks", "period_p99_ms", "follower's tick, p99 period (ms)"),
    ("follower", "ticks", "late_share_1ms", "follower's ticks over 1 ms late, share"),
    ("leader", "link", "latency_p50_ms", "frames, one way, p50 (ms)"),
    ("leader", "link", "latency_p99_ms", "frames, one way, p99 (ms)"),
    ("follower", "link", "latency_p50_ms", "commands, one way, p50 (ms)"),
    ("follower", "link", "latency_p99_ms", "commands, one way, p99 (ms)"),
)


def run(
    duration: Duration = 20.0,
    realtime: RealTime = False,
    strangers: Strangers = False,
    acceleration_rate: AccelerationRate = 1000,
) -> Findings:
    """Run the demo's services; if given, alternate with and without --realtime or --strangers."""
    if realtime and strangers:
        raise InputError("give --realtime or --strangers, not both")
    check_acceleration_rate(acceleration_rate)
    if (realtime or strangers) and acceleration_rate != 1000:
        raise InputError("--acceleration-rate: not with --realtime or --strangers")
    if strangers:
        return disturbed(duration)
    return compare(duration) if realtime else measure(duration, acceleration_rate)


async def run_demo_services(
    duration_s: float,
    scene_name: str = "demo",
    *,
    tables: Sequence[str] = (),
    acceleration_rate_hz: int = 1000,
    realtime: bool = False,
    environment: Mapping[str, str] = os.environ,
    on_link: Callable[[str], None] = lambda _: None,
) -> DemoRun:
    """Run both services of an example scene with more tables, and record to a temporary file."""
    with tempfile.TemporaryDirectory() as directory:
        overrides: dict[str, Any] = {
            "session.duration_s": duration_s,
            "session.acceleration_rate_hz": acceleration_rate_hz,
            "recording.file": str(Path(directory) / "session.mcap"),
        }
        run = await run_services(
            load_scene(scene_name, overrides, tables=tables),
            environment=environment,
            realtime=realtime,
            on_link=on_link,
        )
    if run.failed:
        raise MmtError("the services did not end well: " + "; ".join(run.errors))
    return run


def measure(duration_s: float, acceleration_rate_hz: int = 1000) -> Findings:
    """Run the demo's scene once, with both services as processes."""
    run = asyncio.run(run_demo_services(duration_s, acceleration_rate_hz=acceleration_rate_hz))
    leader, follower = run.leader, run.follower
    link, ticks = leader["link"], leader["ticks"]
    wrong = link["lost"] + link["out_of_order"]
    due = link["frames"] * (acceleration_rate_hz // 1000)
    unrendered = due - leader["vibration"]["actuator"]["samples"]
    texture = leader["texture"]
    rows: dict[str, Figure] = {
        "frames": ("frames received", link["frames"]),
        "frames_lost": ("frames lost or out of order", wrong, "at most", 0),
        "ready_s": ("leader ready after (s)", leader["process"]["ready_s"], "at most", 3),
        "tick_p99_ms": ("rendering tick, p99 period (ms)", ticks["period_p99_ms"], "at most", 1.5),
        "tick_unrendered": ("samples not rendered", unrendered, "at most", 0),
    }
    for key, what in (("update_median_ms", "median"), ("update_longest_ms", "longest")):
        rows[key] = (f"model update, {what} (ms)", texture[key], "at most", 50)
    for name, summary, megabytes in (("leader", leader, 250), ("follower", follower, 120)):
        process = summary["process"]
        rows[f"{name}_core"] = (f"{name}, share of a core", process["core_share"], "at most", 0.6)
        rows[f"{name}_mb"] = (f"{name}, memory (MB)", process["memory_mb"], "at most", megabytes)
    modelling = texture["process"] or {}  # unknown if the process ended before the session
    for key, what in (("core_share", "share of a core"), ("memory_mb", "memory (MB)")):
        rows[f"modelling_{key}"] = (f"leader's modelling process, {what}", modelling.get(key))
    rows |= _beside_modelling(duration_s, acceleration_rate_hz)
    about = (
        f"Leader and follower as two processes, {duration_s:g} s, acceleration at "
        f"{acceleration_rate_hz / 1000:g} kHz: the demo's scene, and for ticks "
        "while modelling a rough texture, whose model is never complete. The host of a virtual "
        "machine takes up to some ms to wake an idle processor, which is no tick's fault: on one, "
        "read the rows with no processor idle."
    )
    return single_figures("Services", about, rows)


def _beside_modelling(duration_s: float, acceleration_rate_hz: int) -> dict[str, Figure]:
    """Return how late the leader's ticks are while it models and while it does not."""
    rows: dict[str, Figure] = {}
    settings: list[tuple[str, str, AbstractContextManager[object], dict[str, float]]] = [
        ("", "", nullcontext(), _MOST_LATE),
        ("busy_", ", beside two busy processes", background_processes(*[(_be_busy,)] * 2), {}),
    ]
    if hasattr(os, "SCHED_IDLE"):
        # the host of a virtual machine takes up to some ms to wake an idle processor
        awake = background_processes(*((_keep_awake, each) for each in os.sched_getaffinity(0)))
        settings.insert(1, ("awake_", ", no processor idle", awake, _MOST_LATE))
    for name, beside, others, targets in settings:
        with others:
            rough = run_demo_services(
                duration_s, "rough-texture", acceleration_rate_hz=acceleration_rate_hz
            )
            ticks = asyncio.run(rough).leader["ticks"]
        p99_ms, p99_otherwise_ms, share, share_otherwise = (
            ticks[f"late_{when}_{figure}"]
            for figure in ("p99_ms", "share_1ms")
            for when in ("while_modelling", "otherwise")
        )
        figures: dict[str, tuple[str, float]] = {
            "p99_ms": ("ticks late while modelling, p99 (ms)", p99_ms),
            "p99_more_ms": ("the same, more than otherwise (ms)", p99_ms - p99_otherwise_ms),
            "share_1ms": ("ticks over 1 ms late while modelling, share", share),
            "share_1ms_more": ("the same, more than otherwise", share - share_otherwise),
        }
        for key, (what, value) in figures.items():
            limit = ("at most", targets[key]) if key in targets else ()
            rows[f"{name}late_modelling_{key}"] = (what + beside, value, *limit)
    return rows


def compare(duration_s: float) -> Findings:
    """Run the demo's services by ordinary and by real-time scheduling, in turns.

    Beside them a busy process runs for each processor, so that the gain shows on an idle machine
    too.
    """
    require_real_time()
    rounds = max(1, round(duration_s / ROUND_S))
    runs: dict[bool, list[DemoRun]] = {False: [], True: []}
    with background_processes(*[(_be_busy,)] * (os.cpu_count() or 1)):
        for _ in range(rounds):
            for realtime, done in runs.items():
                once = run_demo_services(duration_s / rounds, realtime=realtime)
                done.append(asyncio.run(once))
    rows, figures = [], {}
    for service, table, key, what in _FIGURES:
        ordinary, real_time = (
            median_of_known([getattr(run, service)[table][key] for run in runs[way]])
            for way in (False, True)
        )
        rows.append({"what": what, "ordinary": ordinary, "real-time": real_time})
        figures[f"{service}_{key}_ordinary"] = ordinary
        figures[f"{service}_{key}_realtime"] = real_time
    about = (
        f"The demo's scene, leader and follower as two processes, {rounds} runs of "
        f"{duration_s / rounds:g} s each way in turns, beside {os.cpu_count()} busy processes; "
        "medians over the runs."
    )
    title = "Services by ordinary and by real-time scheduling"
    records = (FindingsTable("realtime", title, tuple(rows)),)
    return Findings(title, about, records=records, figures=figures)


def disturbed(duration_s: float) -> Findings:
    """Run the demo's services with a token beside strangers and a bystander, in turns."""
    rounds = max(1, round(duration_s / ROUND_S))
    ways = (_ALONE, disturbing.BYSTANDER, *disturbing.KINDS)
    late: dict[str, list[float]] = {way: [] for way in ways}
    for _ in range(rounds):
        for kind, shares in late.items():
            ticks = asyncio.run(_beside(kind, duration_s / rounds)).leader["ticks"]
            shares.append(ticks["late_share_1ms"])
    about = (
        f"The demo's scene with a token, {rounds} runs of {duration_s / rounds:g} s each way in "
        "turns: ticks over 1 ms late, share of all, beside a stranger who connects anew whenever "
        "the leader closes the connection, and beside a process as busy that connects nowhere."
    )
    means = {kind: sum(shares) / rounds for kind, shares in late.items()}
    bystander = means[disturbing.BYSTANDER]
    rows: dict[str, Figure] = {
        _ALONE: ("nobody", means[_ALONE]),
        disturbing.BYSTANDER: ("a bystander who connects nowhere", bystander),
    }
    for kind, what in disturbing.KINDS.items():
        rows[kind] = (what, means[kind], "at most", max(_FEW_LATE, 2 * bystander))
    return single_figures("Late ticks beside strangers", about, rows)


async def _beside(kind: str, duration_s: float) -> DemoRun:
    """Run the services beside a stranger of this kind or a bystander; `_ALONE` for neither."""
    environment = {**os.environ, "MMT_LINK_TOKEN": secrets.token_hex()}
    with ExitStack() as beside:

        def disturb(url: str) -> None:
            if kind != _ALONE:
                beside.enter_context(background_processes((disturbing.disturb, url, kind)))

        return await run_demo_services(duration_s, environment=environment, on_link=disturb)


def _keep_awake(pipe: Connection, processor: int) -> None:
    """Keep a processor busy at idle priority until the pipe is closed."""
    os.sched_setaffinity(0, {processor})
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    _be_busy(pipe)


def _be_busy(pipe: Connection) -> None:
    """Keep a processor busy until the pipe is closed."""
    while not pipe.poll():
        sum(range(100_000))
