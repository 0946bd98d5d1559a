"""Findings as tables for the terminal and for reports."""

from collections.abc import Sequence
from typing import Final

from mmt.evaluation.document import ReportTable
from mmt_lab.harness.findings import Cell, Findings, FindingsTable, Panel, Spread, Target

_NOTICEABLE: Final = 0.005


def targets_table(results: Sequence[Findings]) -> ReportTable:
    """Return every target of a run beside the figure measured."""
    rows = [
        (target.what, result.name, _number(target.measured), *_aim(target))
        for result in results
        for target in result.targets
    ]
    return ReportTable(("what", "experiment", "measured", "target", "met"), rows, "Targets")


def missed_because(results: Sequence[Findings]) -> list[str]:
    """Return a sentence for each reason why targets are not met or not measured."""
    missed: dict[str, list[str]] = {}
    for target in (target for result in results for target in result.targets):
        if target.reason and target.met is not True:
            missed.setdefault(target.reason, []).append(target.what)
    return [f"not met: {', '.join(names)}: {reason}" for reason, names in missed.items()]


def tables_of(result: Findings) -> list[ReportTable]:
    """Return the tables of findings: their own, panels, records, and methods left out."""
    tables = [*result.tables, *(panel_table(panel) for panel in result.panels)]
    tables += [records_table(records) for records in result.records if records.rows]
    if result.left_out:
        rows = [(out.name, out.reason, out.remedy) for out in result.left_out]
        tables.append(ReportTable(("left out", "because", "remedy"), rows, "Left out"))
    return tables


def panel_table(panel: Panel) -> ReportTable:
    """Return a panel as a table, a row for each point; x is left out if it is the knob itself."""
    over_knob = all(curve.over_knob for curve in panel.curves)
    rows = []
    for curve in panel.curves:
        for index, point in enumerate(curve.points):
            name = curve.method if index == 0 else ""
            x = () if over_knob else (_spread(point.x),)
            rows.append((name, f"{point.knob:g}", *x, _spread(point.y)))
        for knob, reason in curve.failures.items():
            x = () if over_knob else ("-",)
            rows.append((curve.method if not curve.points else "", knob, *x, reason))
    columns = (panel.knob,) if over_knob else (panel.knob, panel.x.short)
    return ReportTable(("method", *columns, panel.y.short), rows, panel.title)


def records_table(records: FindingsTable) -> ReportTable:
    """Return records as a table of text; a name that repeats in the first column is left blank."""
    columns = list(dict.fromkeys(key for row in records.rows for key in row))
    rows: list[tuple[str, ...]] = []
    above: Cell = None
    for row in records.rows:
        first, *others = (row.get(column) for column in columns)
        repeated = isinstance(first, str) and first == above
        rows.append(("" if repeated else _cell(first), *map(_cell, others)))
        above = first
    return ReportTable(columns, rows, records.title)


def _aim(target: Target) -> tuple[str, str]:
    met = {True: "yes", False: "no", None: "not measured"}[target.met]
    tolerance = f" ± {_number(target.tolerance)}" if target.tolerance else ""
    return f"{target.side} {_number(target.bound)}{tolerance}", met


def _spread(value: Spread) -> str:
    share = value.relative
    scatter = f" ±{100 * share:.0f} %" if share >= _NOTICEABLE else ""
    return f"{_number(value.median)}{scatter}"


def _cell(value: Cell) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return _number(value) if isinstance(value, float) else str(value)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
