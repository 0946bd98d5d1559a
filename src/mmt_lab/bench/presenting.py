"""The bench as tables for the terminal and as a report."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from mmt.evaluation.document import Block, Heading, Paragraph, Table
from mmt.evaluation.report_files import picture, write_report_files
from mmt_lab.bench.results import (
    Cell,
    Curve,
    Panel,
    Point,
    Records,
    Spread,
    StageResult,
    Target,
)

TITLE: Final = "Error against run time"
_NOTICEABLE: Final = 0.005


def targets_table(results: Sequence[StageResult]) -> Table:
    """Return every target of a run beside what was measured."""
    rows = [
        (target.what, result.name, _number(target.measured), *_aim(target))
        for result in results
        for target in result.targets
    ]
    return Table(("what", "stage", "measured", "target", "met"), rows, "Targets")


def stage_tables(result: StageResult, *, narrow: bool = False) -> list[Table]:
    """Return a stage's tables: one for each panel, its records, and what was left out.

    Narrow ones, for a terminal, have a row for each setting of a knob in place of a column.
    """
    lay_out = narrow_panel_table if narrow else panel_table
    tables = [lay_out(panel) for panel in result.panels]
    tables += [records_table(records) for records in result.records if records.rows]
    if result.left_out:
        rows = [(out.name, out.reason, out.remedy) for out in result.left_out]
        tables.append(Table(("left out", "because", "remedy"), rows, "Left out"))
    return tables


def panel_table(panel: Panel) -> Table:
    """Return a panel with two rows a method, x and y, and a column for each knob's setting."""
    knobs = list(dict.fromkeys(point.knob for curve in panel.curves for point in curve.points))
    rows, notes = [], []
    for curve in panel.curves:
        at = {point.knob: point for point in curve.points}
        over_knob = _over_knob(curve)
        if not over_knob:
            cells = (_spread(at[knob].x) if knob in at else "-" for knob in knobs)
            rows.append((curve.method, panel.x.short, *cells))
        name = curve.method if over_knob else ""
        rows.append((name, panel.y.short, *(_y(at.get(knob)) for knob in knobs)))
        failed = [f"{knob}: {reason}" for knob, reason in curve.failures.items()]
        notes += [f"{curve.method} at {text}" for text in failed]
    columns = ("method", panel.knob, *(f"{knob:g}" for knob in knobs))
    return Table(columns, rows, ". ".join([panel.title, *notes]))


def narrow_panel_table(panel: Panel) -> Table:
    """Return a panel with a row for each point; x is left out where it is the knob itself."""
    over_knob = all(_over_knob(curve) for curve in panel.curves)
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
    return Table(("method", *columns, panel.y.short), rows, panel.title)


def records_table(records: Records) -> Table:
    """Return rows of a record as text; a name is not repeated below itself."""
    columns = list(dict.fromkeys(key for row in records.rows for key in row))
    rows: list[tuple[str, ...]] = []
    above: Cell = None
    for row in records.rows:
        first, *others = (row.get(column) for column in columns)
        repeated = isinstance(first, str) and first == above
        rows.append(("" if repeated else _cell(first), *map(_cell, others)))
        above = first
    return Table(columns, rows, records.title)


def write_bench_report(
    directory: Path, results: Sequence[StageResult], machine: Mapping[str, str]
) -> Path:
    """Write ``report.md``, ``report.html``, ``figures/`` and ``bench.json``.

    Returns
    -------
    Path
        Of ``report.html``, which holds its figures inside.

    Raises
    ------
    InputError
        The directory cannot be written.
    """
    blocks: list[Block] = [
        Heading(TITLE, 1),
        Paragraph(
            "Methods took turns on the machine below; times are medians over rounds, with half "
            "the distance of the quartiles behind them. Trust the ratios within this run more "
            "than the times."
        ),
        Table(("what", "value"), [(key, value) for key, value in machine.items()], "Machine"),
    ]
    if any(result.targets for result in results):
        blocks.append(targets_table(results))
    for result in results:
        blocks += _stage(result)
    return write_report_files(directory, TITLE, blocks, "bench.json", as_dict(results, machine))


def as_dict(results: Sequence[StageResult], machine: Mapping[str, str]) -> dict[str, Any]:
    """Return a run for a program: the machine, and every stage by its name."""
    return {"machine": dict(machine), **{result.name: result.as_dict() for result in results}}


def _stage(result: StageResult) -> list[Block]:
    blocks: list[Block] = [Heading(result.title), Paragraph(result.about)]
    if result.panels:
        from mmt_lab.bench.plotting import stage_figure

        caption = (
            f"{result.title}: every method a curve, numbers at its ends the setting of the knob; "
            "bars are quartiles; an error of zero is drawn at the bottom."
        )
        blocks.append(picture(result.name, caption, stage_figure(result)))
    return [*blocks, *stage_tables(result)]


def _over_knob(curve: Curve) -> bool:
    """Say whether the curve stands over its knob itself, and not over a time."""
    return all(point.x.median == point.knob for point in curve.points)


def _aim(target: Target) -> tuple[str, str]:
    met = {True: "yes", False: "no", None: "not measured"}[target.met]
    return f"{target.side} {_number(target.bound)}", met


def _y(point: Point | None) -> str:
    return "-" if point is None else _spread(point.y)


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
