"""Evaluations as tables for the terminal, the same as in a report."""

import io
from collections.abc import Sequence

import rich.console

from mmt.core.tables import plain_table
from mmt.evaluation import document, tables
from mmt.evaluation.results import Evaluation


def evaluation_table(evaluations: Sequence[Evaluation]) -> rich.console.Group:
    """Return the figures of the finished models, and the errors of their levels by method."""
    return rich.console.Group(
        as_rich(tables.overview(evaluations)), as_rich(tables.levels(evaluations))
    )


def step_table(evaluation: Evaluation) -> rich.console.Group:
    """Return one row for each step of a session."""
    return as_rich(tables.steps(evaluation))


def heading_tables(evaluations: Sequence[Evaluation]) -> list[rich.console.Group]:
    """Return a table by heading for each session on a texture that depends on it."""
    return [as_rich(tables.by_heading(each)) for each in evaluations if each.by_heading]


def as_text(table: rich.console.RenderableType) -> str:
    """Return a table as plain text of 80 columns."""
    console = rich.console.Console(
        width=80, file=io.StringIO(), color_system=None, force_jupyter=False
    )
    with console.capture() as capture:
        console.print(table)
    return capture.get().rstrip()


def as_rich(table: document.ReportTable) -> rich.console.Group:
    """Return a report's table for the terminal, narrow enough for 80 columns.

    The words of a heading are on lines of their own. Numbers are not broken, texts are.
    """
    result = plain_table(padding=0)
    numeric_columns = document.numeric_columns(table)
    for place, (name, numeric) in enumerate(zip(table.columns, numeric_columns, strict=True)):
        result.add_column(
            name.replace(" ", "\n"),
            justify="right" if numeric else "left",
            no_wrap=numeric,
            min_width=8 if place == 0 and not numeric else None,
            overflow="fold",
            vertical="bottom",
        )
    for row in table.rows:
        result.add_row(*row)
    return (
        rich.console.Group(result, table.caption) if table.caption else rich.console.Group(result)
    )
