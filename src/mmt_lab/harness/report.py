"""Print findings, and write them as a report in one folder."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.text import Text

from mmt.cli.common import output
from mmt.evaluation.document import Block, Heading, Paragraph, ReportTable, as_rich
from mmt.evaluation.report import environment
from mmt.evaluation.report_files import picture, write_report_files
from mmt_lab.harness.findings import Findings
from mmt_lab.harness.tables import missed_because, tables_of, targets_table


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
    """Write the report of one experiment: ``report.html``, ``report.md``, ``summary.json``.

    Parameters
    ----------
    directory
        Created if it does not exist; files of an earlier report are replaced.
    result
        The findings; their pictures are drawn now.

    Returns
    -------
    Path
        The page ``report.html``, with its pictures embedded.

    Raises
    ------
    InputError
        The directory cannot be written.
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
