"""``mmt evaluate --selection``: paper C's Table II again, published against ours."""

from pathlib import Path

from mmt.cli.common import messages, output, write_json
from mmt.evaluation.table import as_rich
from mmt_lab.cli.counting import counting
from mmt_lab.selection.knocks import read_knocks
from mmt_lab.selection.running import run_rows
from mmt_lab.selection.scaling import measure_scaling
from mmt_lab.selection.tables import (
    SelectionEvaluation,
    selection_tables,
    verdicts,
    write_selection_report,
)


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
    with counting("sample selection") as done:
        results = run_rows(seeds, recorded, progress=done)
    evaluation = SelectionEvaluation(results, measure_scaling())
    for table in selection_tables(evaluation):
        output.print(as_rich(table))
    for sentence in verdicts(evaluation):
        output.print(sentence, highlight=False)
    write_json(json_file, evaluation.as_dict())
    if report is not None:
        messages.print(f"report: {write_selection_report(report, evaluation)}")
