"""Evaluate what a run has recorded, and report it."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from mmt.cli.common import output
from mmt.evaluation.evaluate import evaluate_session
from mmt.evaluation.report import write_report
from mmt.evaluation.results import Evaluation
from mmt.evaluation.table import evaluation_table
from mmt.scene import Scene
from mmt.scene_files import load_scene, scene_from_tables
from mmt.session import RecordedSession, read_session
from mmt.texture_table import Texture


def report_recording(directory: Path, recording: Path, run: Mapping[str, Any]) -> dict[str, Any]:
    """Write the report of a run into a directory; return the evaluation's figures.

    Where the scene had no model, or nothing was recorded, the report is of the run alone.
    """
    session = read_session(recording)
    scene = scene_of(session)
    evaluations: list[Evaluation] = []
    if len(session.frames) and scene.texture is not None:
        evaluations.append(replace(evaluate(session, scene), name=scene.session.name))
        output.print(evaluation_table(evaluations))
        output.print(evaluations[0].coverage.remark, highlight=False)
    write_report(
        directory, evaluations, title=scene.session.name, scene=session.scene, run=dict(run)
    )
    return evaluations[0].as_dict() if evaluations else {}


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
