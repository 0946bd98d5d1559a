"""Evaluate and report the recording of a run."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mmt.cli.common import MODEL_NAME, output
from mmt.core.files.existing import write_file
from mmt.evaluation.evaluate import evaluate_surfaces, recorded_scene
from mmt.evaluation.recorded_surfaces import SurfaceParts
from mmt.evaluation.reports.document import Block, as_rich
from mmt.evaluation.reports.report import write_report
from mmt.evaluation.reports.tables import levels, overview
from mmt.evaluation.results import Evaluation, evaluations_as_dict
from mmt.scene import Scene
from mmt.scene.files import load_scene
from mmt.session.mcap.reader import scanned_session
from mmt.session.mcap.scan import scan_mcap
from mmt.session.stream import Recording


def report_recording(
    directory: Path, recording: Path, run: Mapping[str, Any], *, tables: bool
) -> dict[str, Any]:
    """Write the report of a run into a directory, and its last model; return the figures.

    If the scene had no ``[texture]``, or nothing was recorded, the report has only the run's
    summaries. A cut-off recording is read as far as possible. With `tables` the figures are
    printed as well.
    """
    session = scanned_session(scan_mcap(recording))
    scene = scene_of(session)
    evaluations: list[Evaluation] = []
    more: list[Block] = []
    if len(session.frames) and scene.texture is not None:
        found, parts = evaluate_surfaces(session, scene)
        names = [scene.session.name] if parts is None else map("surface {}".format, parts.sessions)
        evaluations = [replace(each, name=name) for each, name in zip(found, names, strict=True)]
        more = surface_section(parts)
        if tables:
            output.print(as_rich(overview(evaluations), levels(evaluations)))
        for evaluation in evaluations if tables else []:
            output.print(remark(evaluation, evaluations))
    write_report(
        directory,
        evaluations,
        title=scene.session.name,
        scene=session.scene,
        run=dict(run),
        more=more,
    )
    model = directory / MODEL_NAME
    model.unlink(missing_ok=True)  # remove the model of an earlier run
    if session.models:
        write_file(model, session.models[-1][1])
    if len(evaluations) > 1:
        return evaluations_as_dict(evaluations)
    return evaluations[0].as_dict() if evaluations else {}


def remark(evaluation: Evaluation, beside: Sequence[Evaluation]) -> str:
    """Return the remark on an evaluation, with its name if there are several."""
    return f"{evaluation.name}: " * (len(beside) > 1) + evaluation.remark


def surface_section(parts: SurfaceParts | None) -> list[Block]:
    """Return a report's section on the surfaces, or [] if surfaces are not distinguished."""
    if parts is None:
        return []
    from mmt.evaluation.reports.surface_report import surface_blocks

    return surface_blocks(parts, parts.stays[-1].to_s)


def scene_of(session: Recording, scene_file: Path | None = None) -> Scene:
    """Return the scene for modelling a session: that of a file, else the recorded one.

    A session without a scene, such as an imported one, gets the defaults.
    """
    return recorded_scene(session) if scene_file is None else load_scene(scene_file)
