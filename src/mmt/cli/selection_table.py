"""``mmt evaluate --selection``: paper C's Table II again, published against ours."""

from pathlib import Path

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from mmt.cli.common import messages, output, write_json
from mmt.evaluation.selection.knocks import read_knocks
from mmt.evaluation.selection.running import run_rows
from mmt.evaluation.selection.scaling import measure_scaling
from mmt.evaluation.selection.tables import (
    SelectionEvaluation,
    selection_tables,
    verdicts,
    write_selection_report,
)
from mmt.evaluation.table import as_rich


def print_selection(
    paths: list[Path], *, seeds: int, json_file: Path | None, report: Path | None
) -> None:
    """Evaluate both methods, print the tables, and write what is asked for.

    Raises
    ------
    InputError
        A recording of knocks cannot be used, or a file not be written.
    """
    recorded = read_knocks(paths)
    if recorded:
        messages.print(f"{len(recorded)} recorded knocks; half of the planted ones are of these")
    progress = Progress(
        TextColumn("sample selection"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f}"),
        TimeElapsedColumn(),
        console=messages,
        transient=True,
    )
    with progress:
        task = progress.add_task("selection", total=1)
        results = run_rows(
            seeds,
            recorded,
            progress=lambda done, every: progress.update(task, completed=done, total=every),
        )
    evaluation = SelectionEvaluation(results, measure_scaling())
    for table in selection_tables(evaluation):
        output.print(as_rich(table))
    for sentence in verdicts(evaluation):
        output.print(sentence, highlight=False)
    write_json(json_file, evaluation.as_dict())
    if report is not None:
        messages.print(f"report: {write_selection_report(report, evaluation)}")
