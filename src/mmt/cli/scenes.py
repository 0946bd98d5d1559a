"""``mmt scene``: show what a scene runs, sends, imports and costs."""

import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from mmt.cli.commands import command_group
from mmt.cli.common import json_option, messages, output, write_json
from mmt.core.extras import require
from mmt.scene import Scene
from mmt.scene.files import load_scene

app = command_group("Show what scenes run and cost.")

_KEY = (
    "± is half the 95 % confidence interval, from what scatters between runs, other programs' load "
    "included; ≈0 is a difference within it. One in twenty lies outside by chance."
)


@app.callback()
def main() -> None:
    """Make `explain` a subcommand although it is the only command."""


@app.command()
def explain(
    scene_file: Annotated[
        Path, typer.Argument(metavar="SCENE", help="A TOML file, or an example's name.")
    ],
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
    from mmt.cli.scene import tables as scene_tables
    from mmt.cli.scene.description import describe_scene

    scene = load_scene(scene_file, replay=replay)
    description = describe_scene(scene)
    content: dict[str, Any] = {"scene": scene.session.name, **description.as_dict()}
    output.print(scene_tables.parts_table(description))
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
        output.print(scene_tables.wire_table(description, bytes_per_s))
    if measured:
        output.print(scene_tables.whole_table(measured))
        for table in scene_tables.part_tables(measured):
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
    from mmt.evaluation.report import machine_table

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
