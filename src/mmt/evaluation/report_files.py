"""Write a report into one folder: Markdown, a page that needs no other file, figures and JSON."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mmt.core.existing_files import write_file
from mmt.evaluation.document import Block, Folded, Picture, SideBySide, to_markdown
from mmt.evaluation.document_html import to_html

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES: Final = "figures"
"""The folder of the PNG files beside the report."""


def picture(name: str, caption: str, figure: "Figure") -> Picture:
    """Return a figure as a block that is kept as ``figures/NAME.png`` beside the report.

    The figure itself is made narrow for the second variant, which only the page holds.
    """
    from mmt.evaluation.figures import stack_panels, to_png

    wide = to_png(figure)
    stack_panels(figure)
    return Picture(f"{FIGURES}/{name}.png", wide, caption, to_png(figure))


def write_report_files(
    directory: Path, title: str, blocks: Sequence[Block], data_name: str, data: Mapping[str, Any]
) -> Path:
    """Write ``report.md``, ``report.html``, the pictures among the blocks, and the data.

    Parameters
    ----------
    directory
        Created if it does not exist; files of an earlier report are replaced.
    title
        Title of the page.
    blocks
        Contents of the report.
    data_name
        Name of the JSON file.
    data
        Contents of the JSON file.

    Returns
    -------
    Path
        Path of ``report.html``, which contains its figures.

    Raises
    ------
    InputError, MmtError
        See `mmt.core.existing_files.replacing`.
    """
    page = directory / "report.html"
    for shown in _pictures(blocks):
        write_file(directory / shown.source, shown.png)
    write_file(directory / "report.md", to_markdown(blocks))
    write_file(directory / data_name, json.dumps(data, indent=2, default=str) + "\n")
    write_file(page, to_html(title, blocks))
    return page


def _pictures(blocks: Sequence[Block]) -> Iterator[Picture]:
    for block in blocks:
        if isinstance(block, Picture):
            yield block
        elif isinstance(block, SideBySide):
            yield from block.pictures
        elif isinstance(block, Folded):
            yield from _pictures(block.blocks)
