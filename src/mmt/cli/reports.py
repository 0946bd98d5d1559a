"""``mmt report``: two reports side by side."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from mmt.cli.common import messages, output, write_json

app = typer.Typer(no_args_is_help=True, help="Compare reports.")


@app.callback()
def _reports() -> None:
    """Keep `compare` a command of its own."""


@app.command()
def compare(
    left: Annotated[Path, typer.Argument(metavar="A", help="A report's folder.")],
    right: Annotated[Path, typer.Argument(metavar="B", help="Another's, of the same kind.")],
    report: Annotated[
        Path | None, typer.Option(help="Write both, with their figures, to this folder.")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the differences.")] = None,
) -> None:
    """Show what differs between two runs, evaluations or measurements."""
    from mmt.evaluation.comparison import COLUMNS, compare_reports, write_comparison

    found = compare_reports(left, right)
    for section, differences in found.sections.items():
        table = Table(title=section or "overall", title_justify="left", pad_edge=False)
        for number, column in enumerate(COLUMNS):
            table.add_column(column, justify="right" if number else "left", overflow="fold")
        for difference in differences:
            table.add_row(*difference.row)
        output.print(table)
    output.print(found.verdict, highlight=False)
    write_json(json_file, found.as_dict())
    if report is not None:
        messages.print(f"report: {write_comparison(found, report)}", highlight=False)
