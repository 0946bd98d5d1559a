"""``mmt evaluate``: recorded sessions, faster than real time."""

from pathlib import Path
from typing import Any

from rich.progress import track

from mmt.cli.common import messages, output, write_json
from mmt.cli.reporting import scene_of, surface_section
from mmt.evaluation.document import Block
from mmt.evaluation.evaluate import evaluate_surfaces
from mmt.evaluation.report import write_report
from mmt.evaluation.results import Evaluation, evaluations_as_dict
from mmt.evaluation.table import evaluation_table, heading_tables, step_table
from mmt.session import read_session


def evaluate_files(
    paths: list[Path],
    *,
    scene_file: Path | None,
    step_s: float,
    seed: int,
    json_file: Path | None,
    report: Path | None,
) -> None:
    """Evaluate session files, print the table, and write the files that were asked for."""
    evaluations: list[Evaluation] = []
    scenes: list[dict[str, Any]] = []
    more: list[Block] = []
    for path in track(paths, "evaluating", console=messages, transient=True):
        session = read_session(path)
        scene = scene_of(session, scene_file)
        found, parts = evaluate_surfaces(session, scene, step_s=step_s, seed=seed)
        evaluations += found
        more += surface_section(parts)
        scenes += [scene.dump()] * len(found)
    if len(evaluations) == 1:
        output.print(step_table(evaluations[0]))
    output.print(evaluation_table(evaluations))
    for by_heading in heading_tables(evaluations):
        output.print(by_heading)
    for evaluation in evaluations:
        output.print(
            f"{evaluation.name}: {evaluation.coverage.remark} Evaluated "
            f"{evaluation.times_real_time:.0f} times faster than real time.",
            highlight=False,
        )
    write_json(json_file, evaluations_as_dict(evaluations))
    if report is not None:
        one = all(scene == scenes[0] for scene in scenes)
        names = [evaluation.name for evaluation in evaluations]
        shown = scenes[0] if one else dict(zip(names, scenes, strict=True))
        write_report(report, evaluations, title="Evaluation", scene=shown, more=more)
        messages.print(f"report: {report / 'report.html'}", highlight=False)
