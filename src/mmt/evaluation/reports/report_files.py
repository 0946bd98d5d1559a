"""Write a report into one folder: Markdown, a page that needs no other file, figures and JSON."""

import base64
import html
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mmt.core.files.existing import write_file
from mmt.core.output.palette import style_sheet
from mmt.evaluation.reports.document import (
    Block,
    Folded,
    Heading,
    Listing,
    Paragraph,
    Picture,
    ReportTable,
    SideBySide,
    Tile,
    Tiles,
    numeric_columns,
    to_markdown,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FIGURES: Final = "figures"
"""The folder of the PNG files beside the report."""

_LONG: Final = 40
"""Length of text from which a cell is a sentence, kept broad enough to be read on a phone."""

_PHONE: Final = "(max-width: 40rem)"

_STYLE: Final = """
* { box-sizing: border-box; }
body { font: 16px/1.55 system-ui, sans-serif; color: var(--ink); background: var(--panel);
  max-width: 66rem; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 1rem; }
h2 { font-size: 1.3rem; margin: 2.4rem 0 .6rem; padding-bottom: .25rem;
  border-bottom: 1px solid var(--line); }
h3 { font-size: 1.05rem; margin: 1.6rem 0 .4rem; }
p { max-width: 46rem; }
.scroll { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; color: var(--faint); padding-bottom: .35rem;
  max-width: calc(100vw - 2.4rem); }
th, td { padding: .3rem .75rem; border-bottom: 1px solid var(--line); text-align: left;
  vertical-align: top; }
th { background: var(--ground); font-weight: 600; vertical-align: bottom; }
.number { text-align: right; }
td.number { white-space: nowrap; }
td.sentence { min-width: 13rem; }
.tables { columns: 19rem; column-gap: 2rem; }
.tables td { overflow-wrap: anywhere; }
.tables td:not(.number) { min-width: 7.5rem; }
.tables .scroll { break-inside: avoid; margin-top: 0; }
.tiles { display: grid; gap: .8rem; margin: 1rem 0; padding: 0; list-style: none;
  grid-template-columns: repeat(auto-fit, minmax(min(14rem, 100%), 1fr)); }
.tiles li { padding: .6rem .9rem; border: 1px solid var(--line); border-radius: 6px; }
.tiles b { display: block; font-size: 1.25rem; line-height: 1.3; }
.tiles span { color: var(--faint); font-size: .92rem; }
.tiles [data-state="degraded"] { background: var(--degraded); color: var(--on-degraded); }
.tiles [data-state="failed"] { background: var(--fault); color: var(--on-fault); }
.tiles [data-state] span { color: inherit; }
figure { margin: 1.2rem 0; }
figure img { max-width: 100%; height: auto; border-radius: 6px;
  border: 1px solid var(--line); }
.beside { display: grid; gap: 0 1.2rem;
  grid-template-columns: repeat(auto-fit, minmax(min(22rem, 100%), 1fr)); }
.wide { grid-template-columns: 1fr; }
figcaption { color: var(--faint); font-size: .92rem; max-width: 46rem; }
summary { cursor: pointer; margin-top: 1.2rem; font-weight: 600; }
pre { background: var(--ground); padding: .8rem 1rem; overflow-x: auto; border-radius: 6px;
  font-size: .85rem; line-height: 1.4; }
@media (max-width: 60rem) { th, td { padding: .3rem .4rem; } }
@media print {
  body { max-width: none; margin: 0; padding: 0; font-size: 10pt; }
  .scroll, pre { overflow: visible; }
  pre { white-space: pre-wrap; }
  th, td { padding: .15rem .2rem; }
  h2, h3, caption { break-after: avoid; }
  figure, tr { break-inside: avoid; }
  details::details-content { display: block; content-visibility: visible; }
}
"""


def picture(name: str, caption: str, figure: "Figure") -> Picture:
    """Return a figure as a block that is kept as ``figures/NAME.png`` beside the report.

    The figure itself is made narrow for the second variant, which only the page holds.
    """
    from mmt.evaluation.reports.figures import stack_panels, to_png

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
        See `mmt.core.files.existing.replacing`.
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
        elif isinstance(block, SideBySide | Folded):
            yield from _pictures(block.blocks)


def to_html(title: str, blocks: Sequence[Block]) -> str:
    """Return the blocks as one HTML page that needs no other file and no network."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>{style_sheet()}{_STYLE}</style>\n</head>\n"
        f"<body>\n{_html_all(blocks)}\n</body>\n</html>\n"
    )


def _html(block: Block) -> str:
    match block:
        case Heading():
            text = f"<h{block.level}>{html.escape(block.text)}</h{block.level}>"
        case Paragraph():
            text = f"<p>{html.escape(block.text)}</p>"
        case Tiles():
            text = f'<ul class="tiles">{"".join(map(_html_tile, block.tiles))}</ul>'
        case Picture():
            text = _html_picture(block)
        case SideBySide():
            text = f'<div class="{block.kind}">{_html_all(block.blocks)}</div>'
        case Folded():
            text = _folded(block.title, _html_all(block.blocks))
        case Listing():
            text = _folded(block.title, f"<pre>{html.escape(block.text)}</pre>")
        case ReportTable():
            text = _html_table(block)
    return text


def _html_all(blocks: Sequence[Block]) -> str:
    return "\n".join(map(_html, blocks))


def _folded(title: str, inner: str) -> str:
    return f"<details><summary>{html.escape(title)}</summary>\n{inner}</details>"


def _html_tile(tile: Tile) -> str:
    title, value, note = (html.escape(text) for text in (tile.title, tile.value, tile.note))
    state = f' data-state="{tile.state}"' if tile.state else ""
    return f"<li{state}><span>{title}</span><b>{value}</b><span>{note}</span></li>"


def _html_picture(picture: Picture) -> str:
    caption = html.escape(picture.caption, quote=True)
    narrow = ""
    if picture.narrow is not None:
        narrow = f'<source media="{_PHONE}" srcset="{_as_url(picture.narrow)}">'
    return (
        f'<figure><picture>{narrow}<img src="{_as_url(picture.png)}" alt="{caption}"></picture>'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _as_url(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"


def _html_table(table: ReportTable) -> str:
    numeric = numeric_columns(table)

    def cells(tag: str, texts: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{_class(tag, text, right)}>{html.escape(text)}</{tag}>"
            for text, right in zip(texts, numeric, strict=True)
        )

    caption = f"<caption>{html.escape(table.caption)}</caption>" if table.caption else ""
    rows = "\n".join(f"<tr>{cells('td', row)}</tr>" for row in table.rows)
    return (
        f'<div class="scroll"><table>{caption}<thead><tr>{cells("th", table.columns)}</tr>'
        f"</thead><tbody>\n{rows}\n</tbody></table></div>"
    )


def _class(tag: str, text: str, right: bool) -> str:
    if right:
        return " class=number"
    return " class=sentence" if tag == "td" and len(text) > _LONG else ""
