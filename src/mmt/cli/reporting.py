"""Evaluate what a run has recorded, and report it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mmt.cli.common import output
from mmt.evaluation.document import Block
from mmt.evaluation.evaluate import evaluate_session
from mmt.evaluation.report import write_report
from mmt.evaluation.results import Evaluation, evaluations_as_dict
from mmt.evaluation.table import evaluation_table
from mmt.scene import Scene, Texture
from mmt.scene.files import load_scene, scene_from_tables
from mmt.session import RecordedSession, read_session


def report_recording(directory: Path, recording: Path, run: Mapping[str, Any]) -> dict[str, Any]:
    """Write the report of a run into a directory; return the evaluation's figures.

    Where the scene had no model, or nothing was recorded, the report is of the run alone.
    """
    session = read_session(recording)
    scene = scene_of(session)
    evaluations: list[Evaluation] = []
    more: list[Block] = []
    if len(session.frames) and scene.texture is not None:
        evaluations, more = evaluate_all(session, scene, name=scene.session.name)
        output.print(evaluation_table(evaluations))
        for evaluation in evaluations:
            output.print(remark(evaluation, evaluations), highlight=False)
    write_report(
        directory,
        evaluations,
        title=scene.session.name,
        scene=session.scene,
        run=dict(run),
        more=more,
    )
    if len(evaluations) > 1:
        return evaluations_as_dict(evaluations)
    return evaluations[0].as_dict() if evaluations else {}


def remark(evaluation: Evaluation, beside: Sequence[Evaluation]) -> str:
    """Say what an evaluation's coverage is, and of which session where there are several."""
    return f"{evaluation.name}: " * (len(beside) > 1) + evaluation.coverage.remark


def evaluate_all(
    session: RecordedSession,
    scene: Scene,
    *,
    name: str | None = None,
    step_s: float = 2.5,
    seed: int = 0,
) -> tuple[list[Evaluation], list[Block]]:
    """Evaluate a session; where its scene tells surfaces apart, the model of each.

    Parameters
    ----------
    session, scene, step_s, seed
        As of `evaluate`.
    name
        Of the session, where it is the only one; its file's name where it is one of many.

    Returns
    -------
    evaluations
        One, or one for each surface.
    more
        What a report says of the surfaces.
    """
    stem = session.path.stem or "session"
    if scene.texture is None or scene.texture.surfaces is None or not len(session.frames):
        return [replace(evaluate(session, scene, step_s=step_s, seed=seed), name=name or stem)], []
    from mmt.evaluation.recorded_surfaces import part_by_surface
    from mmt.evaluation.surface_blocks import surface_blocks

    parts = part_by_surface(session, scene.texture.settings(float(scene.session.rate_hz)))
    evaluations = [
        replace(
            evaluate(part, scene, step_s=step_s, seed=seed),
            name=f"surface {number}" if name else f"{stem}, surface {number}",
            missing_frames=parts.missing[number],
        )
        for number, part in parts.sessions.items()
    ]
    return evaluations, surface_blocks(parts, parts.stays[-1].to_s)


def scene_of(session: RecordedSession, scene_file: Path | None = None) -> Scene:
    """Return the scene that says how to model a session: a file's, else the recorded one's.

    A session without a scene, such as an imported one, is modelled with the defaults.
    """
    if scene_file is not None:
        return load_scene(scene_file)
    if session.scene is None:
        return Scene()
    return scene_from_tables(dict(session.scene), origin=f"the scene recorded in {session.path}")


def evaluate(
    session: RecordedSession, scene: Scene, *, step_s: float = 2.5, seed: int = 0
) -> Evaluation:
    """Evaluate a session with the modelling of a scene, or with the defaults."""
    texture = scene.texture or Texture()
    return evaluate_session(
        session,
        texture.settings(float(scene.session.rate_hz)),
        period_s=texture.update_period_s,
        step_s=step_s,
        seed=seed,
    )
