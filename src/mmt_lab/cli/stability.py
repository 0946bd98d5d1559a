"""``mmt stability``: the stiff and extreme cases, a row each."""

from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from mmt.cli.common import messages, output, print_error, write_json
from mmt.evaluation import document
from mmt_lab.harness.cases import Row, broken, run_case
from mmt_lab.stability import report
from mmt_lab.stability.families import load_cases


def run_stability(names: list[str], *, json_file: Path | None, report_to: Path | None) -> bool:
    """Run the named families of cases, print and write what came out; say if all held.

    Raises
    ------
    InputError
        A name is none of the families, or a file cannot be written.
    """
    rows = _run(names)
    for family in report.by_family(rows).values():
        output.print(_table(report.family_table(family)))
    write_json(json_file, report.summary(rows))
    if report_to is not None:
        page = report.write_stability_report(report_to, rows)
        messages.print(f"report: {page}", highlight=False)
    messages.print(report.verdict(rows), highlight=False)
    for row in broken(rows):
        print_error(f"{row.family}: {row.what}: expected {row.expected}; got {row.got}")
    return not broken(rows)


def _table(content: document.Table) -> Table:
    """Return a family's rows for the terminal; long texts go on in the next line."""
    table = Table(title=content.caption, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in content.columns[:-1]:
        table.add_column(name, ratio=1, overflow="fold")
    table.add_column(content.columns[-1], no_wrap=True)
    for row in content.rows:
        table.add_row(*row, style=None if row[-1] == "yes" else "red")
    return table


def _run(names: list[str]) -> list[Row]:
    families = load_cases(names)
    progress = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=messages,
        transient=True,
    )
    with progress:
        task = progress.add_task("stability", total=sum(map(len, families.values())))

        rows: list[Row] = []
        for name, cases in families.items():
            for case in cases:
                progress.update(task, description=f"{name}: {case.what}"[:60])
                rows.append(run_case(name, case))
                progress.advance(task)
    return rows
