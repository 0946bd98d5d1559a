"""Evaluations as tables for the terminal, the same as in a report."""

from collections.abc import Sequence

import rich.table

from mmt.evaluation import document, tables
from mmt.evaluation.results import Evaluation


def evaluation_table(evaluations: Sequence[Evaluation]) -> rich.table.Table:
    """Return one row for each session, with the figures of the finished model."""
    return as_rich(tables.overview(evaluations))


def step_table(evaluation: Evaluation) -> rich.table.Table:
    """Return one row for each step of a session."""
    return as_rich(tables.steps(evaluation))


def as_rich(table: document.Table) -> rich.table.Table:
    """Return a report's table for the terminal."""
    result = rich.table.Table(title=table.caption or None, title_justify="left", pad_edge=False)
    for name, numeric in zip(table.columns, document.numeric_columns(table), strict=True):
        result.add_column(name, justify="right" if numeric else "left")
    for row in table.rows:
        result.add_row(*row)
    return result
