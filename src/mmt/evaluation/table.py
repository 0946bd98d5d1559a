"""Evaluations as tables for the terminal, the same as in a report."""

from collections.abc import Sequence

import rich.box
import rich.console
import rich.table

from mmt.evaluation import document, tables
from mmt.evaluation.results import Evaluation


def evaluation_table(evaluations: Sequence[Evaluation]) -> rich.console.Group:
    """Return one row for each session, with the figures of the finished model."""
    return as_rich(tables.overview(evaluations))


def step_table(evaluation: Evaluation) -> rich.console.Group:
    """Return one row for each step of a session."""
    return as_rich(tables.steps(evaluation))


def as_rich(table: document.Table) -> rich.console.Group:
    """Return a report's table for the terminal, narrow enough for 80 columns.

    The words of a heading stand below each other; only the first column may be cut.
    """
    result = rich.table.Table(
        box=rich.box.SIMPLE_HEAD,
        padding=0,
        pad_edge=False,
    )
    for place, name in enumerate(table.columns):
        numeric = document.numeric_columns(table)[place]
        result.add_column(
            name.replace(" ", "\n"),
            justify="right" if numeric else "left",
            no_wrap=place > 0,
            min_width=12 if place == 0 and not numeric else None,
            overflow="fold",
            vertical="bottom",
        )
    for row in table.rows:
        result.add_row(*row)
    return (
        rich.console.Group(result, table.caption) if table.caption else rich.console.Group(result)
    )
