"""``mmt evaluate --feedback``: force feedback over a delay, a method beside the other."""

from pathlib import Path

from mmt.cli.common import messages, output, write_json
from mmt.evaluation.table import as_rich
from mmt_lab.cli.counting import counting
from mmt_lab.feedback.recorded import find_runs
from mmt_lab.feedback.results import evaluate_feedback
from mmt_lab.feedback.tables import feedback_tables, verdicts, write_feedback_report


def print_feedback(
    paths: list[Path], *, seed: int, json_file: Path | None, report: Path | None
) -> None:
    """Evaluate the methods, print the tables, and write what is asked for.

    Raises
    ------
    InputError
        A recording cannot be used, or a file not be written.
    """
    with counting("force feedback") as done:
        evaluation = evaluate_feedback(find_runs(paths), seed=seed, progress=done)
    for table in feedback_tables(evaluation):
        output.print(as_rich(table))
    for sentence in verdicts(evaluation):
        output.print(sentence, highlight=False)
    write_json(json_file, evaluation.as_dict())
    if report is not None:
        page = write_feedback_report(report, evaluation)
        messages.print(f"report: {page}", highlight=False)
