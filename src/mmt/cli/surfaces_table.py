"""``mmt evaluate --surfaces``: sessions over several known surfaces, simulated or recorded."""

from pathlib import Path

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, track

from mmt.cli.common import messages, output, write_json
from mmt.cli.reporting import scene_of
from mmt.devices.simulated.course import course_from_annotations
from mmt.errors import InputError
from mmt.evaluation.surfaces.running import SurfaceResult, run_session, run_simulated
from mmt.evaluation.surfaces.tables import (
    SurfaceEvaluation,
    surface_tables,
    verdicts,
    write_surface_report,
)
from mmt.evaluation.table import as_rich
from mmt.session import read_session
from mmt.texture.settings import ModellingSettings


def print_surfaces(
    paths: list[Path], *, seeds: int, json_file: Path | None, report: Path | None
) -> None:
    """Score the sessions, or simulated ones where none is named; print and write the tables.

    Raises
    ------
    InputError
        A session has no course over known surfaces, or a file cannot be written.
    """
    results = [_recorded(path) for path in _shown(paths)] if paths else _simulated(seeds)
    evaluation = SurfaceEvaluation(results)
    for table in surface_tables(evaluation):
        output.print(as_rich(table))
    for sentence in verdicts(evaluation):
        output.print(sentence, highlight=False)
    write_json(json_file, evaluation.as_dict())
    if report is not None:
        messages.print(f"report: {write_surface_report(report, evaluation)}", highlight=False)


def _shown(paths: list[Path]) -> list[Path]:
    return list(track(paths, "surfaces", console=messages, transient=True))


def _recorded(path: Path) -> SurfaceResult:
    session = read_session(path)
    scene = scene_of(session, None)
    modelling = (
        scene.texture.settings(float(scene.session.rate_hz))
        if scene.texture is not None
        else ModellingSettings()
    )
    try:
        course = course_from_annotations(session.annotations)
        return run_session(path.stem, course, session.frames, modelling)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _simulated(seeds: int) -> list[SurfaceResult]:
    progress = Progress(
        TextColumn("sessions over several surfaces"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f}"),
        TimeElapsedColumn(),
        console=messages,
        transient=True,
    )
    with progress:
        task = progress.add_task("surfaces", total=1)
        return run_simulated(
            seeds, lambda done, every: progress.update(task, completed=done, total=every)
        )
