"""The report of an evaluation that judges: sentences, then figures, definitions and versions."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mmt.evaluation.document import Block, Heading, Paragraph, Table
from mmt.evaluation.report import environment
from mmt.evaluation.report_files import write_report_files


def write_judged_report(
    directory: Path,
    title: str,
    sentences: Sequence[str],
    blocks: Sequence[Block],
    definitions: Mapping[str, str],
    data: Mapping[str, Any],
    settings: Sequence[Table] = (),
) -> Path:
    """Write ``report.html``, ``report.md``, ``summary.json`` and the pictures among the blocks.

    Parameters
    ----------
    directory
        Made where it does not exist.
    title
        Of the page.
    sentences
        What was found.
    blocks
        What shows it.
    definitions
        Of the figures.
    data
        For a program; the versions are added.
    settings
        What else was measured with, behind the definitions.

    Returns
    -------
    Path
        Of the page.

    Raises
    ------
    InputError
        The directory cannot be written.
    """
    versions = environment()
    whole: list[Block] = [
        Heading(title, 1),
        *(Paragraph(sentence) for sentence in sentences),
        *blocks,
        Heading("Definitions"),
        Table(("figure", "what"), list(definitions.items())),
        *settings,
        Heading("Made with"),
        Table(("part", "version"), list(versions.items())),
    ]
    summary = {**data, "environment": versions}
    return write_report_files(directory, title, whole, "summary.json", summary)
