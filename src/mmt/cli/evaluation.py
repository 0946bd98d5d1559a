"""``mmt evaluate``: a person's own recorded sessions, faster than real time."""

from pathlib import Path
from typing import Annotated

import typer


def evaluate(
    sessions: Annotated[list[Path], typer.Argument(metavar="SESSION...")],
    scene_file: Annotated[
        Path | None, typer.Option("--scene", help="Take \\[texture] from this scene.")
    ] = None,
    step: Annotated[float, typer.Option(help="Seconds between the rows.")] = 2.5,
    seed: Annotated[int, typer.Option(min=0, help="Chooses the segments that are held out.")] = 0,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a report there.")] = None,
) -> None:
    """Evaluate recorded sessions: distance and fit against session time."""
    from mmt.cli.evaluating import evaluate_files

    evaluate_files(
        sessions, scene_file=scene_file, step_s=step, seed=seed, json_file=json_file, report=report
    )
