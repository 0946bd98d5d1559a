"""A document of a few kinds of blocks, written as Markdown and as one self-contained HTML file."""

import base64
import html
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

from mmt.core.palette import style_sheet


@dataclass(frozen=True)
class Heading:
    """A heading of level 1 (the title) to 3."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Paragraph:
    """Running text."""

    text: str


@dataclass(frozen=True)
class Table:
    """Rows of cells that are already text; numeric columns stand to the right."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


@dataclass(frozen=True)
class Picture:
    """A PNG: `source` is its place beside the Markdown file, `png` its content."""

    source: str
    png: bytes
    caption: str


@dataclass(frozen=True)
class SideBySide:
    """Pictures to be compared; one above the other where they are wide or the page is narrow."""

    pictures: Sequence[Picture]

    @property
    def inner(self) -> Sequence[Picture]:
        """Return the items that are shown side by side."""
        return self.pictures

    @property
    def kind(self) -> str:
        """Return the class in HTML: a picture may be too wide to be read on half a page."""
        sizes = [(each.png[16:20], each.png[20:24]) for each in self.pictures]  # as PNG has them
        wide = any(
            int.from_bytes(width, "big") > _WIDE * int.from_bytes(height, "big")
            for width, height in sizes
        )
        return "beside wide" if wide else "beside"


@dataclass(frozen=True)
class SmallTables:
    """Tables that are shown side by side where there is room."""

    tables: Sequence[Table]
    kind: ClassVar = "tables"

    @property
    def inner(self) -> Sequence[Table]:
        """Return the items that are shown side by side."""
        return self.tables


@dataclass(frozen=True)
class Listing:
    """Text to be shown as it is, folded away in HTML under its title."""

    title: str
    text: str


Block = Heading | Paragraph | Table | Picture | SideBySide | SmallTables | Listing

_WIDE: Final = 2.6
_LONG: Final = 40
"""Characters from which a cell is a sentence: kept broad enough to be read on a phone."""

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
figure { margin: 1.2rem 0; }
figure img { max-width: 100%; height: auto; border-radius: 6px;
  border: 1px solid var(--line); }
.beside { display: grid; gap: 0 1.2rem;
  grid-template-columns: repeat(auto-fit, minmax(min(22rem, 100%), 1fr)); }
.wide { grid-template-columns: 1fr; }
figcaption { color: var(--faint); font-size: .92rem; max-width: 46rem; }
summary { cursor: pointer; margin-top: 1rem; }
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


def to_markdown(blocks: Sequence[Block]) -> str:
    """Return the blocks as Markdown; pictures are referred to by their source."""
    return "\n".join(_markdown(block) for block in blocks)


def to_html(title: str, blocks: Sequence[Block]) -> str:
    """Return the blocks as one HTML page that needs no other file and no network."""
    body = "\n".join(_html(block) for block in blocks)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>{style_sheet()}{_STYLE}</style>\n</head>\n"
        f"<body>\n{body}\n</body>\n</html>\n"
    )


_MARKDOWN: Final = str.maketrans({"&": "&amp;", "<": "&lt;", "[": r"\["})
"""Markdown passes HTML on to the browser, and a name such as a file's may be anything."""


def _plain(text: str) -> str:
    """Return a text as one line of Markdown that holds neither HTML nor a link."""
    return " ".join(text.split()).translate(_MARKDOWN)


def _markdown(block: Block) -> str:
    if isinstance(block, Heading):
        return f"{'#' * block.level} {_plain(block.text)}\n"
    if isinstance(block, Paragraph):
        return f"{_plain(block.text)}\n"
    if isinstance(block, Picture):
        caption = _plain(block.caption)
        return f"![{caption}]({block.source})\n\n*{caption}*\n"
    if isinstance(block, SideBySide | SmallTables):
        return "\n".join(map(_markdown, block.inner))
    if isinstance(block, Listing):
        fence = "`" * max(3, 1 + max(map(len, re.findall("`+", block.text)), default=0))
        return f"{_plain(block.title)}:\n\n{fence}\n{block.text.rstrip()}\n{fence}\n"
    return _markdown_table(block)


def _markdown_table(table: Table) -> str:
    def line(cells: Sequence[str]) -> str:
        escaped = (_plain(cell).replace("|", r"\|") for cell in cells)
        return f"| {' | '.join(escaped)} |"

    rulers = ["---:" if numeric else "---" for numeric in numeric_columns(table)]
    lines = [line(table.columns), f"| {' | '.join(rulers)} |", *(line(row) for row in table.rows)]
    caption = f"{_plain(table.caption)}\n\n" if table.caption else ""
    return caption + "\n".join(lines) + "\n"


def _html(block: Block) -> str:
    if isinstance(block, Heading):
        return f"<h{block.level}>{html.escape(block.text)}</h{block.level}>"
    if isinstance(block, Paragraph):
        return f"<p>{html.escape(block.text)}</p>"
    if isinstance(block, Picture):
        data = base64.b64encode(block.png).decode("ascii")
        caption = html.escape(block.caption, quote=True)
        return (
            f'<figure><img src="data:image/png;base64,{data}" alt="{caption}">'
            f"<figcaption>{caption}</figcaption></figure>"
        )
    if isinstance(block, SideBySide | SmallTables):
        return f'<div class="{block.kind}">{"".join(map(_html, block.inner))}</div>'
    if isinstance(block, Listing):
        return (
            f"<details><summary>{html.escape(block.title)}</summary>"
            f"<pre>{html.escape(block.text)}</pre></details>"
        )
    return _html_table(block)


def _html_table(table: Table) -> str:
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


def numeric_columns(table: Table) -> list[bool]:
    """Return for each column whether all its cells are numbers or dashes."""
    columns = [[row[index] for row in table.rows] for index in range(len(table.columns))]
    return [
        any(map(_is_number, cells)) and all(_is_number(cell) or cell in _EMPTY for cell in cells)
        for cells in columns
    ]


_EMPTY: Final = frozenset({"", "-", "never"})


def _is_number(cell: str) -> bool:
    try:
        float(cell.removesuffix("%").strip())
    except ValueError:
        return False
    return True
