"""``mmt evaluate`` and ``mmt report``: evaluate recorded sessions, and compare two reports."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import track

from mmt.cli.common import json_option, messages, output, report_option, write_json
from mmt.cli.main import command_group
from mmt.core.extras import require
from mmt.core.kernel_cache import compile_kernels
from mmt.core.running.process import release_compiler

if TYPE_CHECKING:
    from mmt.evaluation.reports.document import Block
    from mmt.evaluation.results import Evaluation

reports = command_group("Compare reports.")


def evaluate(
    sessions: Annotated[
        list[Path], typer.Argument(metavar="SESSION...", help="Recorded sessions.")
    ],
    scene_file: Annotated[
        Path | None, typer.Option("--scene", help="Take \\[texture] from this scene.")
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(help="Seconds between the rows; 2.5 if absent, more in long recordings."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Chooses the segments that are held out.")] = 0,
    json_file: Annotated[Path | None, json_option("Write the figures.")] = None,
    report: Annotated[Path | None, report_option()] = None,
) -> None:
    """Evaluate recorded sessions: distance and fit against session time."""
    if report is not None:
        require("matplotlib")
    compile_kernels(["mmt.cli.reporting"], messages.print)
    from mmt.cli.reporting import scene_of, surface_section
    from mmt.evaluation.evaluate import evaluate_surfaces
    from mmt.evaluation.reports.report import write_report
    from mmt.evaluation.results import evaluations_as_dict
    from mmt.session.stream import open_recording

    release_compiler()
    evaluations: list[Evaluation] = []
    scenes: list[dict[str, Any]] = []
    more: list[Block] = []
    for path in track(sessions, "evaluating", console=messages, transient=True):
        session = open_recording(path)
        scene = scene_of(session, scene_file)
        found, parts = evaluate_surfaces(session, scene, step_s=step, seed=seed)
        evaluations += found
        if report is not None:
            more += surface_section(parts)
        scenes += [scene.dump()] * len(found)
    _show(evaluations)
    write_json(json_file, evaluations_as_dict(evaluations))
    if report is not None:
        one = all(scene == scenes[0] for scene in scenes)
        names = [evaluation.name for evaluation in evaluations]
        shown = scenes[0] if one else dict(zip(names, scenes, strict=True))
        write_report(report, evaluations, title="Evaluation", scene=shown, more=more)
        messages.print(f"report: {report / 'report.html'}")


def _show(evaluations: "list[Evaluation]") -> None:
    """Print the tables and a remark on each session."""
    from mmt.evaluation.reports.document import as_rich
    from mmt.evaluation.reports.tables import heading_tables, levels, overview, steps

    if len(evaluations) == 1:
        output.print(as_rich(steps(evaluations[0])))
    shown = [overview(evaluations), levels(evaluations), *heading_tables(evaluations)]
    output.print(as_rich(*shown))
    for evaluation in evaluations:
        output.print(
            f"{evaluation.name}: {evaluation.remark} Evaluated "
            f"{evaluation.times_real_time:.0f} times faster than real time."
        )


@reports.command()
def compare(
    left: Annotated[Path, typer.Argument(metavar="A", help="A report's folder.")],
    right: Annotated[Path, typer.Argument(metavar="B", help="Another's, of the same kind.")],
    report: Annotated[
        Path | None, report_option("Write both, with their figures, to this folder.")
    ] = None,
    json_file: Annotated[Path | None, json_option("Write the differences.")] = None,
) -> None:
    """Show what differs between two runs, evaluations or measurements."""
    from mmt.evaluation.reports.comparison import compare_reports
    from mmt.evaluation.reports.comparison_report import write_comparison
    from mmt.evaluation.reports.document import as_rich

    if report is not None:
        require("matplotlib")
    found = compare_reports(left, right)
    output.print(as_rich(*found.answers))
    for sentence in [*found.missing_parts, f"{found.verdict} --report DIR shows them all."]:
        output.print(sentence)
    write_json(json_file, found.as_dict())
    if report is not None:
        messages.print(f"report: {write_comparison(found, report)}")
