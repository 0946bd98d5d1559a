"""``mmt evaluate --end-to-end``: what the operator feels, over each network."""

import os
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from mmt.cli.common import messages, output, write_json
from mmt.errors import InputError
from mmt.evaluation.end_to_end.presenting import felt_table, write_felt_report
from mmt.evaluation.end_to_end.summary import as_dict, cases, feel_all
from mmt.evaluation.methods.cases import known_textures
from mmt.evaluation.table import as_rich


def print_felt(
    *,
    seeds: int,
    textures: str | None,
    workers: int | None,
    json_file: Path | None,
    report: Path | None,
) -> None:
    """Run the sessions, print the table, and write what is asked for.

    Raises
    ------
    InputError
        A texture is not known, or a file cannot be written.
    """
    if workers is not None and workers < 1:
        raise InputError(f"--workers {workers}: at least 1")
    named = None if textures is None else [name.strip() for name in textures.split(",")]
    chosen = cases(seeds, known_textures(named))
    columns = (TextColumn("stroking"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=messages, transient=True) as progress:
        task = progress.add_task("", total=len(chosen))
        outcomes = feel_all(
            chosen,
            min(workers or os.cpu_count() or 1, len(chosen)),
            lambda done: progress.update(task, completed=done),
        )
    output.print(as_rich(felt_table(outcomes)))
    write_json(json_file, as_dict(outcomes))
    if report is not None:
        messages.print(f"report: {write_felt_report(report, outcomes)}", highlight=False)
