"""``mmt evaluate --compare``: methods of texture modelling side by side."""

import os
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from mmt.cli.common import messages, output, write_json
from mmt.errors import InputError
from mmt.evaluation.methods.cases import recorded_cases, simulated_cases
from mmt.evaluation.methods.judging import check_methods
from mmt.evaluation.methods.running import run_cases
from mmt.evaluation.methods.summary import MethodComparison
from mmt.evaluation.methods.tables import method_tables, verdicts, write_method_report
from mmt.evaluation.table import as_rich


def print_methods(
    compared: str,
    strokes: list[Path],
    *,
    seeds: int,
    textures: str | None,
    workers: int | None,
    json_file: Path | None,
    report: Path | None,
) -> None:
    """Judge the methods, print the tables, and write what is asked for.

    Raises
    ------
    InputError
        A method or texture is not known, or a file cannot be written.
    """
    methods = [name.strip() for name in compared.split(",")]
    check_methods(methods)
    if workers is not None and workers < 1:
        raise InputError(f"--workers {workers}: at least 1")
    chosen = None if textures is None else [name.strip() for name in textures.split(",")]
    cases = simulated_cases(seeds, chosen)
    recorded, remarks = recorded_cases(strokes, chosen)
    for remark in remarks:
        messages.print(remark, highlight=False)
    cases += recorded
    columns = (TextColumn("comparing"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=messages, transient=True) as progress:
        task = progress.add_task("", total=len(cases))
        judged = run_cases(
            cases,
            methods,
            min(workers or os.cpu_count() or 1, len(cases)),
            lambda done: progress.update(task, completed=done),
        )
    comparison = MethodComparison(tuple(methods), tuple(judged), tuple(remarks))
    for table in method_tables(comparison):
        output.print(as_rich(table))
    for sentence in verdicts(comparison):
        output.print(sentence, highlight=False)
    write_json(json_file, comparison.as_dict())
    if report is not None:
        messages.print(f"report: {write_method_report(report, comparison)}", highlight=False)
