"""``mmt bench``: error against run time, and the link, the services and the evaluation."""

import asyncio
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from mmt.cli.common import messages
from mmt.core.errors import InputError, MmtError
from mmt.evaluation.document import Block, Paragraph, Table
from mmt.evaluation.report import machine
from mmt.scene.files import example_scenes, load_scene
from mmt_lab.bench import STAGES, run_stage
from mmt_lab.cli.realtime_gain import compare
from mmt_lab.harness.findings import Findings, LeftOut, Records, Side, Target
from mmt_lab.harness.report import print_findings, print_targets, write_joint_report

EVALUATIONS: Final = 5
"""Repetitions of the evaluation; the median counts."""

SUSTAINED_P99_MS: Final = 10.0
"""Bound on the latency at the sustained rate: what waits longer piles up."""

TITLE: Final = "Error against run time"

EXTRA: Final = "pip install 'mmt-haptics[bench]'"

Row = tuple[str, float | int | None] | tuple[str, float | int | None, Side, float]
"""What, the figure, and where there is one its target."""


def run_benches(
    names: list[str], duration_s: float, report: Path | None = None, *, realtime: bool = False
) -> tuple[list[Findings], dict[str, Any]]:
    """Run the named stages, all of them where none is named; print each as it is done.

    Parameters
    ----------
    names
        Of stages.
    duration_s
        Seconds for each measurement of the link and of the services.
    report
        Where a report is written, None for none.
    realtime
        Measure link and devices by real-time scheduling, and the services with and without it.

    Returns
    -------
    results, figures
        Every stage that could be measured, and what ``--json`` writes; under ``failed`` the
        others with the reason, where there are any.

    Raises
    ------
    InputError
        A name is none of the stages, or the report cannot be written.
    """
    stages = _stages(duration_s, realtime)
    unknown = [name for name in names if name not in stages]
    if unknown:
        raise InputError(f"bench {unknown[0]}: allowed are {', '.join(stages)}")
    results, failed = [], {}
    for name in dict.fromkeys(names or stages):
        messages.print(f"measuring: {name}")
        try:
            results.append(replace(stages[name](), name=name))
        except MmtError as error:  # what the others measure, which may take an hour, is kept
            failed[name] = str(error)
            messages.print(f"{name}: {error}", highlight=False)
        else:
            print_findings(results[-1])
    print_targets(results)
    about = machine()
    if report is not None:
        page = write_bench_report(report, results, about)
        messages.print(f"report: {page}", highlight=False)
    return results, as_dict(results, about) | ({"failed": failed} if failed else {})


def as_dict(results: Sequence[Findings], machine: Mapping[str, str]) -> dict[str, Any]:
    """Return a run for a program: the machine, and every stage by its name."""
    return {"machine": dict(machine), **{result.name: result.as_dict() for result in results}}


def write_bench_report(
    directory: Path, results: Sequence[Findings], machine: Mapping[str, str]
) -> Path:
    """Write ``report.md``, ``report.html``, ``figures/`` and ``bench.json``; return the page.

    Raises
    ------
    InputError
        The directory cannot be written.
    """
    opening: list[Block] = [
        Paragraph(
            "Methods took turns on the machine below; times are medians over rounds, with half "
            "the distance of the quartiles behind them. Trust the ratios within this run more "
            "than the times."
        ),
        Table(("what", "value"), list(machine.items()), "Machine"),
    ]
    data = as_dict(results, machine)
    return write_joint_report(directory, TITLE, opening, results, "bench.json", data)


def _stages(duration_s: float, realtime: bool) -> dict[str, Callable[[], Findings]]:
    stages: dict[str, Callable[[], Findings]] = {
        name: lambda name=name: _or_left_out(name)  # type: ignore[misc]
        for name in STAGES
    }
    return {
        **stages,
        "link": lambda: _link(duration_s, realtime),
        "services": lambda: compare(duration_s) if realtime else _services(duration_s),
        "evaluate": _evaluate,
        "devices": lambda: _devices(realtime),
    }


def _or_left_out(name: str) -> Findings:
    """Run a stage, or say that it needs a package that is not there."""
    try:
        return run_stage(name)
    except ImportError as error:
        missing = error.name or str(error)
        left_out = LeftOut(missing, "the stage needs it for its reference", EXTRA)
        return Findings(name, "Not measured.", left_out=(left_out,))


def _figures(title: str, about: str, rows: dict[str, Row]) -> Findings:
    """Return single figures as a stage."""
    targets = tuple(Target(row[0], row[1], row[2], row[3]) for row in rows.values() if len(row) > 2)
    table = tuple({"what": row[0], "measured": row[1]} for row in rows.values())
    return Findings(
        title,
        about,
        records=(Records("figures", title, table),),
        targets=targets,
        figures={key: row[1] for key, row in rows.items()},
    )


def _services(duration_s: float) -> Findings:
    """Run the demo's scene with both services as processes."""
    from mmt.cli.demo import run_services

    with tempfile.TemporaryDirectory() as directory:
        scene_file = example_scenes()["demo"]
        recording = Path(directory) / "session.mcap"
        scene = load_scene(
            scene_file,
            {"session.duration_s": duration_s, "recording.file": str(recording)},
        )
        run = asyncio.run(run_services(scene_file, scene, duration_s, None))
    if run.failed:
        raise InputError("the services did not end well: " + "; ".join(run.errors))
    leader, follower = run.leader, run.follower
    link, ticks = leader["link"], leader["ticks"]
    wrong = link["lost"] + link["out_of_order"]
    unrendered = link["frames"] - leader["vibration"]["actuator"]["samples"]
    late_ms = ticks["late_while_modelling_p99_ms"]
    texture = leader["texture"]
    rows: dict[str, Row] = {
        "frames": ("frames received", link["frames"]),
        "frames_lost": ("frames lost or out of order", wrong, "at most", 0),
        "ready_s": ("leader ready after (s)", leader["process"]["ready_s"], "at most", 3),
        "tick_p99_ms": ("rendering tick, p99 period (ms)", ticks["period_p99_ms"], "at most", 1.5),
        "tick_unrendered": ("samples not rendered", unrendered, "at most", 0),
        "late_while_modelling_p99_ms": (
            "tick late while modelling, p99 (ms)",
            late_ms,
            "at most",
            1,
        ),
    }
    for key, what in (("update_median_ms", "median"), ("update_longest_ms", "longest")):
        rows[key] = (f"model update, {what} (ms)", texture[key], "at most", 50)
    for name, summary, megabytes in (("leader", leader, 250), ("follower", follower, 120)):
        process = summary["process"]
        rows[f"{name}_core"] = (f"{name}, share of a core", process["core_share"], "at most", 0.6)
        rows[f"{name}_mb"] = (f"{name}, memory (MB)", process["memory_mb"], "at most", megabytes)
    about = f"The demo's scene, leader and follower as two processes, {duration_s:g} s."
    return _figures("Services", about, rows)


def _devices(realtime: bool) -> Findings:
    """Read emulated devices by their drivers."""
    from mmt_lab.bench.devices import Plan, run

    return run(Plan(realtime=realtime))


def _evaluate() -> Findings:
    """Evaluate a simulated session several times."""
    from mmt.evaluation.evaluate import evaluate_session
    from mmt_lab.bench.textures import session

    recorded = session("wood", 18.0)
    evaluate_session(recorded)
    times_s = []
    for _round in range(EVALUATIONS):
        started = time.perf_counter()
        evaluate_session(recorded)
        times_s.append(time.perf_counter() - started)
    median_s = statistics.median(times_s)
    rows: dict[str, Row] = {
        "times_real_time": (
            "evaluation, times faster than real time",
            18.0 / median_s,
            "at least",
            50,
        ),
        "median_s": ("18 s session, median (s)", median_s),
        "spread_s": ("longest less shortest (s)", max(times_s) - min(times_s)),
    }
    about = f"An 18 s session, evaluated {EVALUATIONS} times as mmt evaluate does."
    return _figures("Evaluation", about, rows)


def _link(duration_s: float, realtime: bool) -> Findings:
    """Compare the link with a bare WebSocket in the same run."""
    from mmt_lab.link_bench import bench_link

    result = bench_link(duration_s, realtime=realtime)
    rows: dict[str, Row] = {}
    for way, direction in (("up", result.ours.up), ("down", result.ours.down)):
        wrong = direction.lost + direction.out_of_order
        rows[f"{way}_lost"] = (f"{way}: lost or out of order", wrong, "at most", 0)
        rows[f"{way}_p50_ms"] = (f"{way}: one way, p50 (ms)", direction.p50_ms)
        rows[f"{way}_p99_ms"] = (f"{way}: one way, p99 (ms)", direction.p99_ms)
    for name, ratio in result.ratios.items():
        what = f"{name.replace('_', ' ')}: ours over bare WebSocket"
        rows[f"ratio_{name}"] = (what, ratio, "at most", 1.5)
    fast = result.sustained
    for way, direction in (("up", fast.up), ("down", fast.down)):
        at, wrong = f"{way} at {result.sustained_hz} Hz", direction.lost + direction.out_of_order
        rows[f"sustained_{way}_hz"] = (
            f"{at}: messages a second",
            direction.rate_hz,
            "at least",
            0.99 * result.sustained_hz,
        )
        rows[f"sustained_{way}_lost"] = (f"{at}: lost or out of order", wrong, "at most", 0)
        rows[f"sustained_{way}_p99_ms"] = (
            f"{at}: one way, p99 (ms)",
            direction.p99_ms,
            "at most",
            SUSTAINED_P99_MS,
        )
    about = (
        "One frame a message up and one command a message down at 1 kHz, in turns of a second "
        f"with a bare WebSocket, {duration_s:g} s each; ratios are medians over neighbouring turns."
        + (" By real-time scheduling." if realtime else "")
    )
    return _figures("Link", about, rows)
