"""``mmt scene``: show what a scene runs, sends, imports and costs."""

import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from mmt.cli.common import json_option, messages, output, write_json
from mmt.cli.main import command_group
from mmt.cli.running.service import SceneFile
from mmt.core.extras import require
from mmt.core.output.tables import plain_table
from mmt.scene import Scene
from mmt.scene.files import load_scene

if TYPE_CHECKING:
    from mmt.cli.scene.description import SceneDescription, Stream

app = command_group("Show what scenes run and cost.")

_KEY = (
    "± is half the 95 % confidence interval, from what scatters between runs, other programs' load "
    "included; ≈0 is a difference within it. One in twenty lies outside by chance."
)

_FIGURES: Final = {
    "start_s": ("start (s)", 2),
    "core_share": ("core share", 2),
    "memory_mb": ("memory (MB)", 1),
}
"""Heading and digits of each of `mmt.cli.scene.costs.FIGURES`."""


@app.command()
def explain(
    scene_file: SceneFile,
    replay: Annotated[
        Path | None, typer.Option(help="Replay this recorded session; else a simulated one.")
    ] = None,
    measure: Annotated[
        bool, typer.Option("--measure/--no-measure", help="Run it, or only read it.")
    ] = True,
    parts: Annotated[
        bool, typer.Option("--parts/--no-parts", help="Run it also without each of its parts.")
    ] = True,
    duration: Annotated[float, typer.Option(min=1.0, max=600.0, help="Seconds of each run.")] = 3.0,
    rounds: Annotated[int, typer.Option(min=2, max=100, help="Runs of each, in turns.")] = 2,
    devices: Annotated[
        bool, typer.Option("--devices", help="Measure although the scene moves real devices.")
    ] = False,
    json_file: Annotated[Path | None, json_option("Write the figures.")] = None,
) -> None:
    """Show what a scene runs, sends and imports, and measure what each part costs."""
    from mmt.cli.scene.description import describe_scene

    scene = load_scene(scene_file, replay=replay)
    description = describe_scene(scene)
    content: dict[str, Any] = {"scene": scene.session.name, **asdict(description)}
    output.print(_parts_table(description))
    if description.robot_limits is not None:
        output.print(f"The robot's limits: {description.robot_limits}")
    if description.acceleration is not None:
        output.print(f"The acceleration: {description.acceleration}")
    if description.hand_force is not None:
        output.print(f"The hand's force: {description.hand_force}")
    moves = scene.devices is not None and not devices
    measured: dict[str, Any] = {}
    if measure and not moves:
        measured = content["measured"] = _measure(scene, duration, rounds, parts)
    if description.streams:
        bytes_per_s = measured.get("bytes_per_s", {})
        output.print(_wire_table(description, bytes_per_s))
    if measured:
        output.print(_whole_table(measured))
        for table in _part_tables(measured):
            output.print(table)
        if measured["parts"]:
            output.print(_KEY)
        for sentence in measured["remarks"]:
            output.print(f"- {sentence}")
    elif moves and measure:
        messages.print("not measured: the scene moves real devices; --devices measures it")
    write_json(json_file, content)


def _measure(scene: Scene, duration_s: float, rounds: int, parts: bool) -> dict[str, Any]:
    """Measure the costs; return them, with a table of this machine."""
    require("scipy")
    from mmt.cli.scene.costs import measure_scene
    from mmt.cli.scene.runs import SceneRunner
    from mmt.evaluation.reports.report import machine_table

    progress = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=messages,
        transient=True,
    )
    with tempfile.TemporaryDirectory(prefix="mmt-explain-") as directory, progress:
        task = progress.add_task("once to warm up", total=None)

        def show(what: str, number: int, total: int) -> None:
            progress.update(task, description=what, completed=number, total=total)

        runner = SceneRunner(Path(directory), duration_s)
        prepared = runner.prepare(scene)
        runner.warm_up(prepared)
        costs = measure_scene(prepared, runner, rounds=rounds, parts=parts, on_step=show)
    return {"machine": machine_table(), **costs.as_dict()}


def _parts_table(description: "SceneDescription") -> Table:
    """Return a table of the parts that run in each service, and those left out."""
    table = plain_table("Parts")
    for name in ("service", "runs", "tasks", "left out"):
        table.add_column(name, ratio=None if name == "service" else 1)
    for name, side in (("leader", description.leader), ("follower", description.follower)):
        if side is None:
            table.add_row(name, "none in this scene", "", "")
            continue
        runs, tasks, left_out = map(", ".join, (side.runs, side.tasks, side.left_out))
        table.add_row(name, runs or "nothing", tasks, left_out or "nothing")
    return table


def _wire_table(description: "SceneDescription", bytes_per_s: Mapping[str, float]) -> Table:
    """Return a table of the streams: sizes as computed, and the rates that the link counted."""
    table = plain_table("On the wire")
    table.add_column("way")
    table.add_column("carries", ratio=1)
    for name in ("bytes each", "message bytes", "messages /s", "kB /s"):
        table.add_column(_stacked(name), justify="right")
    if bytes_per_s:
        table.add_column("kB/s\nmeasured", justify="right")
    for stream in description.streams:
        table.add_row(
            stream.way,
            _carried(stream),
            str(stream.record_bytes),
            str(stream.message_bytes),
            f"{stream.messages_per_s:.0f}",
            f"{stream.bytes_per_s / 1e3:.1f}",
            *([f"{bytes_per_s[stream.way] / 1e3:.1f}"] if bytes_per_s else []),
        )
    return table


def _carried(stream: "Stream") -> str:
    count, holds = stream.records_per_message, ", ".join(stream.holds)
    return f"{stream.event}{f', {count} a message' if count > 1 else ''}: {holds}"


def _whole_table(measured: Mapping[str, Any]) -> Table:
    """Return a table of the whole scene's services, of `SceneCosts.as_dict`."""
    runs, duration_s = measured["runs"], measured["duration_s"]
    table = plain_table(f"The whole scene: mean of {runs} runs of {duration_s:g} s, least and most")
    table.add_column("")
    services = measured["services"]
    for service in services:
        table.add_column(service, ratio=1, overflow="fold")
    for name, (label, digits) in _FIGURES.items():
        table.add_row(label, *(_mean(figures[name], digits) for figures in services.values()))
    table.add_row("modules", *(str(f["modules"]) for f in services.values()))
    table.add_row("packages", *(", ".join(f["packages"]) for f in services.values()))
    return table


def _mean(value: Mapping[str, float], digits: int) -> str:
    least, mean, most = (f"{value[name]:.{digits}f}" for name in ("least", "mean", "most"))
    return f"{mean} ({least} to {most})"


def _part_tables(measured: Mapping[str, Any]) -> Iterable[Table]:
    """Yield a table of the parts' costs for the leader, and one of what the follower sends for."""
    for service in measured["services"]:
        parts = {
            name: part
            for name, part in measured["parts"].items()
            if service == "leader" or part["bytes_per_s"].get("up")
        }
        if parts:
            yield _part_table(parts, service, sends=len(measured["services"]) > 1)


def _part_table(parts: Mapping[str, Any], service: str, *, sends: bool) -> Table:
    table = plain_table(f"What a part costs the {service}: with it less without it")
    table.add_column("part", ratio=1, vertical="bottom")
    labels = [label for label, _ in _FIGURES.values()]
    for label in [*labels, *(["up kB/s"] if sends else []), "own modules"]:
        table.add_column(_stacked(label), justify="right", vertical="bottom")
    for name, part in parts.items():
        figures, sent = part[service], part["bytes_per_s"].get("up")
        table.add_row(
            name,
            *(_difference(figures[each], digits) for each, (_, digits) in _FIGURES.items()),
            *([f"{sent / 1e3:.1f}" if sent else "-"] if sends else []),
            str(figures["modules"] or "-"),
        )
    return table


def _difference(cost: Mapping[str, float], digits: int) -> str:
    value = f"{cost['difference']:.{digits}f}" if cost["seen"] else "≈0"
    return f"{value} ±{cost['half_width']:.{digits}f}"


def _stacked(name: str) -> str:
    return name.replace(" ", "\n", 1)
