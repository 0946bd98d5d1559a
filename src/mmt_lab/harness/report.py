"""Print findings, and write them as a report in one folder."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.text import Text

from mmt.cli.common import output
from mmt.evaluation.document import Block, Heading, Paragraph, ReportTable
from mmt.evaluation.report import environment
from mmt.evaluation.report_files import picture, write_report_files
from mmt.evaluation.table import as_rich
from mmt_lab.harness.findings import Findings
from mmt_lab.harness.tables import missed_because, tables_of, targets_table


def print_findings(result: Findings) -> None:
    """Print title, tables and sentences; `print_targets` prints the targets."""
    output.print(result.title, style="bold")
    if result.about:
        output.print(result.about, highlight=False)
    for table in tables_of(result):
        print_table(table)
    for sentence in result.sentences:
        output.print(sentence, highlight=False)


def print_targets(results: Sequence[Findings]) -> None:
    """Print the targets of a run beside the figures measured, if there are any."""
    if any(result.targets for result in results):
        print_table(targets_table(results))
        for sentence in missed_because(results):
            output.print(sentence, highlight=False)


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
    blocks: list[Block] = [Heading(result.title, 1), *_found(result)]
    if result.definitions:
        rows = list(result.definitions.items())
        blocks += [Heading("Definitions"), ReportTable(("figure", "what"), rows)]
    blocks += result.settings
    blocks += [Heading("Made with"), ReportTable(("part", "version"), list(versions.items()))]
    data = {**result.as_dict(), "environment": versions}
    if result.definitions:
        data["definitions"] = dict(result.definitions)
    return write_report_files(directory, result.title, blocks, "summary.json", data)


def write_joint_report(
    directory: Path,
    title: str,
    opening: Sequence[Block],
    results: Sequence[Findings],
    data_name: str,
    data: Mapping[str, Any],
) -> Path:
    """Write one report of several experiments, all targets first.

    Parameters
    ----------
    directory, title
        As in `mmt.evaluation.report_files.write_report_files`.
    opening
        Blocks below the title.
    results
        Findings of each experiment.
    data_name, data
        Name and content of the JSON file beside the page.

    Raises
    ------
    InputError
        The directory cannot be written.
    """
    blocks: list[Block] = [Heading(title, 1), *opening]
    if any(result.targets for result in results):
        blocks.append(targets_table(results))
        blocks += [Paragraph(sentence) for sentence in missed_because(results)]
    for result in results:
        blocks += [Heading(result.title), *_found(replace(result, targets=()))]
    return write_report_files(directory, title, blocks, data_name, data)


def _found(result: Findings) -> list[Block]:
    """Return the blocks of findings, without heading and definitions."""
    texts = [result.about, *result.sentences, *result.failures]
    blocks: list[Block] = [Paragraph(text) for text in texts if text]
    if result.targets:
        blocks.append(targets_table([result]))
        blocks += [Paragraph(sentence) for sentence in missed_because([result])]
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
