"""``mmt evaluate --surfaces``: sessions over several known surfaces, simulated or recorded."""

from pathlib import Path

from mmt.cli.common import messages, output, write_json
from mmt.cli.reporting import scene_of
from mmt.core.errors import InputError
from mmt.evaluation.table import as_rich
from mmt.session import read_session
from mmt.testing.simulation.course import course_from_annotations
from mmt.texture.settings import ModellingSettings
from mmt_lab.cli.counting import Counted, counting
from mmt_lab.surfaces.running import SurfaceResult, run_session, run_simulated
from mmt_lab.surfaces.tables import (
    SurfaceEvaluation,
    surface_tables,
    verdicts,
    write_surface_report,
)


def print_surfaces(
    paths: list[Path], *, seeds: int, seed: int, json_file: Path | None, report: Path | None
) -> None:
    """Score the sessions, or simulated ones where none is named; print and write the tables.

    Raises
    ------
    InputError
        A session has no course over known surfaces, or a file cannot be written.
    """
    with counting("sessions over several surfaces", len(paths) or 1) as done:
        results = _recorded(paths, done) if paths else run_simulated(seeds, done, first=seed)
    evaluation = SurfaceEvaluation(results)
    for table in surface_tables(evaluation):
        output.print(as_rich(table))
    for sentence in verdicts(evaluation):
        output.print(sentence, highlight=False)
    write_json(json_file, evaluation.as_dict())
    if report is not None:
        messages.print(f"report: {write_surface_report(report, evaluation)}", highlight=False)


def _recorded(paths: list[Path], done: Counted) -> list[SurfaceResult]:
    results = []
    for path in paths:
        results.append(_score(path))
        done(len(results))
    return results


def _score(path: Path) -> SurfaceResult:
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
