"""``mmt bench``: the link, the services and the evaluation, measured on this machine."""

import asyncio
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from rich.table import Table

from mmt.cli.common import messages
from mmt.errors import InputError
from mmt.scene import Scene
from mmt.scene_files import example_scenes, load_scene

EVALUATIONS: Final = 5
"""Repetitions of the evaluation; the median counts."""

Row = tuple[str, float | int | None, str]
"""What, the figure, and what it is to be."""


def run_benches(names: list[str], duration_s: float) -> tuple[list[Table], dict[str, Any]]:
    """Run the named measurements, all of them where none is named.

    Raises
    ------
    InputError
        A name is none of the measurements.
    """
    benches: dict[str, Callable[[float], dict[str, Row]]] = {
        "link": _link,
        "services": _services,
        "evaluate": _evaluate,
    }
    unknown = [name for name in names if name not in benches]
    if unknown:
        raise InputError(f"bench {unknown[0]}: allowed are {', '.join(benches)}")
    tables, figures = [], {}
    for name in names or benches:
        messages.print(f"measuring: {name}")
        rows = benches[name](duration_s)
        tables.append(_table(name, rows))
        figures[name] = {key: value for key, (_, value, _) in rows.items()}
    return tables, figures


def _table(title: str, rows: dict[str, Row]) -> Table:
    table = Table(title=title, title_justify="left", pad_edge=False)
    table.add_column("what")
    table.add_column("measured", justify="right")
    table.add_column("target", justify="right")
    for what, value, target in rows.values():
        text = "-" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)
        table.add_row(what, text, target)
    return table


def _services(duration_s: float) -> dict[str, Row]:
    """Run the demo's scene with both services as processes."""
    from mmt.cli.demo import run_services

    with tempfile.TemporaryDirectory() as directory:
        scene_file = example_scenes()["demo"]
        recording = Path(directory) / "session.mcap"
        scene = load_scene(
            scene_file,
            {"session.duration_s": duration_s},
            record=recording,
        )
        run = asyncio.run(run_services(scene_file, scene, duration_s, None))
    if run.failed:
        raise InputError("the services did not end well: " + "; ".join(run.errors))
    leader, follower = run.leader, run.follower
    link, ticks = leader["link"], leader["ticks"]
    return {
        "frames": ("frames received", link["frames"], ""),
        "frames_lost": ("frames lost or out of order", link["lost"] + link["out_of_order"], "0"),
        "ready_s": ("leader ready after (s)", leader["process"]["ready_s"], "3"),
        "tick_p99_ms": ("rendering tick, p99 period (ms)", ticks["period_p99_ms"], "1.5"),
        "tick_unrendered": (
            "samples not rendered",
            link["frames"] - leader["vibration"]["actuator"]["samples"],
            "0 or less",
        ),
        "late_while_modelling_p99_ms": (
            "tick late while modelling, p99 (ms)",
            ticks["late_while_modelling_p99_ms"],
            "1",
        ),
        "update_median_ms": (
            "model update, median (ms)",
            leader["texture"]["update_median_ms"],
            "50",
        ),
        "update_longest_ms": (
            "model update, longest (ms)",
            leader["texture"]["update_longest_ms"],
            "50",
        ),
        "leader_core": ("leader, share of a core", leader["process"]["core_share"], "0.6"),
        "follower_core": ("follower, share of a core", follower["process"]["core_share"], "0.6"),
        "leader_mb": ("leader, memory (MB)", leader["process"]["memory_mb"], "250"),
        "follower_mb": ("follower, memory (MB)", follower["process"]["memory_mb"], "120"),
    }


def _evaluate(_: float) -> dict[str, Row]:
    """Evaluate a simulated session several times."""
    from mmt.cli.reporting import evaluate
    from mmt.devices.simulated.offline import simulate_session
    from mmt.session import RecordedSession

    scene = Scene()
    frames, annotations = simulate_session(scene, "wood", 18.0, 1)
    session = RecordedSession(frames=frames, annotations=annotations)
    evaluate(session, scene)
    times_s = []
    for _round in range(EVALUATIONS):
        started = time.perf_counter()
        evaluate(session, scene)
        times_s.append(time.perf_counter() - started)
    median_s = statistics.median(times_s)
    return {
        "times_real_time": ("evaluation, times faster than real time", 18.0 / median_s, "50"),
        "median_s": ("18 s session, median (s)", median_s, ""),
        "spread_s": ("longest less shortest (s)", max(times_s) - min(times_s), ""),
    }


def _link(duration_s: float) -> dict[str, Row]:
    """Compare the link with a bare WebSocket in the same run."""
    from mmt.evaluation.link_bench import bench_link

    result = bench_link(duration_s)
    rows: dict[str, Row] = {}
    for way, direction in (("up", result.ours.up), ("down", result.ours.down)):
        rows[f"{way}_lost"] = (
            f"{way}: lost or out of order",
            direction.lost + direction.out_of_order,
            "0",
        )
        rows[f"{way}_p50_ms"] = (f"{way}: one way, p50 (ms)", direction.p50_ms, "")
        rows[f"{way}_p99_ms"] = (f"{way}: one way, p99 (ms)", direction.p99_ms, "")
    targets = {"p50": "2.5", "p99": "3.5"}
    for name, ratio in result.ratios.items():
        target = targets.get(name.partition("_")[2], "")
        rows[f"ratio_{name}"] = (
            f"{name.replace('_', ' ')}: ours over bare WebSocket",
            ratio,
            target,
        )
    return rows
