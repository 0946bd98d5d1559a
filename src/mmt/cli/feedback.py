"""``mmt evaluate --feedback``: force feedback over a delay, a method beside the other."""

from pathlib import Path

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from mmt.cli.common import messages, output, write_json
from mmt.evaluation.feedback.recorded import find_runs
from mmt.evaluation.feedback.results import FeedbackEvaluation, evaluate_feedback
from mmt.evaluation.feedback.tables import feedback_tables, verdicts, write_feedback_report
from mmt.evaluation.table import as_rich


def print_feedback(
    paths: list[Path], *, seed: int, json_file: Path | None, report: Path | None
) -> None:
    """Evaluate the methods, print the tables, and write what is asked for.

    Raises
    ------
    InputError
        A recording cannot be used, or a file not be written.
    """
    evaluation = _evaluate(find_runs(paths), seed)
    for table in feedback_tables(evaluation):
        output.print(as_rich(table))
    for sentence in verdicts(evaluation):
        output.print(sentence, highlight=False)
    write_json(json_file, evaluation.as_dict())
    if report is not None:
        page = write_feedback_report(report, evaluation)
        messages.print(f"report: {page}", highlight=False)


def _evaluate(paths: list[Path], seed: int) -> FeedbackEvaluation:
    progress = Progress(
        TextColumn("force feedback"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} cells"),
        TimeElapsedColumn(),
        console=messages,
        transient=True,
    )
    with progress:
        task = progress.add_task("feedback", total=1)
        return evaluate_feedback(
            paths,
            seed=seed,
            progress=lambda done, every: progress.update(task, completed=done, total=every),
        )
