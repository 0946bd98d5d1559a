"""Findings as tables, printed, and written as a report in one folder."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from rich.text import Text

from mmt.cli.common import output
from mmt.evaluation.reports.document import Block, Heading, Paragraph, ReportTable, as_rich
from mmt.evaluation.reports.report import environment
from mmt.evaluation.reports.report_files import picture, write_report_files
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
    """Return a median, and half the distance of the quartiles over it if that is noticeable."""
    share = 0.5 * (value.high - value.low) / value.median if value.median else 0.0
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


def print_findings(result: Findings) -> None:
    """Print title, tables and sentences; `print_targets` prints the targets."""
    output.print(result.title, style="bold")
    if result.about:
        output.print(result.about)
    for table in tables_of(result):
        print_table(table)
    for sentence in result.sentences:
        output.print(sentence)


def print_targets(results: Sequence[Findings]) -> None:
    """Print the targets of a run beside the figures measured, if there are any."""
    if any(result.targets for result in results):
        print_table(targets_table(results))
        for sentence in missed_because(results):
            output.print(sentence)


def print_table(table: ReportTable) -> None:
    """Print a table with its caption above."""
    output.print(Text(f"\n{table.caption}", style="italic"))
    output.print(as_rich(replace(table, caption="")))


def write_report(directory: Path, result: Findings) -> Path:
    """Draw the pictures of one experiment, and write its report with the data ``summary.json``.

    Directory, result and errors are those of `write_report_files`.
    """
    versions = environment()
    blocks: list[Block] = [Heading(result.title, 1), *found_blocks(result)]
    if result.definitions:
        rows = list(result.definitions.items())
        blocks += [Heading("Definitions"), ReportTable(("figure", "what"), rows)]
    blocks += result.settings
    blocks += [Heading("Made with"), ReportTable(("part", "version"), list(versions.items()))]
    data = {**result.as_dict(), "environment": versions}
    return write_report_files(directory, result.title, blocks, "summary.json", data)


def target_blocks(results: Sequence[Findings]) -> list[Block]:
    """Return the targets of a run, if there are any, and why some are not met."""
    if not any(result.targets for result in results):
        return []
    return [targets_table(results), *map(Paragraph, missed_because(results))]


def found_blocks(result: Findings) -> list[Block]:
    """Return the blocks of findings, without heading and definitions."""
    texts = [result.about, *result.sentences, *result.failures]
    blocks: list[Block] = [Paragraph(text) for text in texts if text]
    blocks += target_blocks([result])
    if result.panels:
        from mmt_lab.harness.plots import panels_figure

        caption = (
            f"{result.title}: every method a curve, numbers at its ends the setting of the knob; "
            "bars are quartiles; an error of zero is drawn at the bottom."
        )
        blocks.append(picture(result.name, caption, panels_figure(result)))
    if result.blocks is None:
        return blocks + tables_of(result)
    return [*blocks, *result.blocks(), *tables_of(replace(result, tables=()))]
