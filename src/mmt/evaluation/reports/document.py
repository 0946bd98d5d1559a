"""A document of a few kinds of blocks, written as Markdown, and its tables in a terminal."""

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rich.console import Group, RenderableType


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
class ReportTable:
    """Rows of cells that are already text; numeric columns stand to the right."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


def table_of(rows: Sequence[Mapping[str, str]], caption: str = "") -> ReportTable:
    """Return rows with the same keys as a table, whose columns are the keys."""
    columns = list(rows[0]) if rows else []
    return ReportTable(columns, [list(row.values()) for row in rows], caption)


@dataclass(frozen=True)
class Tile:
    """One answer at a glance: ``state`` is "running", "degraded", "failed", or "" for no colour."""

    title: str
    value: str
    note: str = ""
    state: str = ""


@dataclass(frozen=True)
class Tiles:
    """Answers beside each other."""

    tiles: Sequence[Tile]


@dataclass(frozen=True)
class Picture:
    """A PNG: `source` is its place beside the Markdown file, `png` its content.

    ``narrow`` is the same for a telephone, None if there is none.
    """

    source: str
    png: bytes
    caption: str
    narrow: bytes | None = None


@dataclass(frozen=True)
class SideBySide:
    """Small tables, or pictures to be compared, beside each other if there is room."""

    blocks: Sequence[ReportTable] | Sequence[Picture]

    @property
    def kind(self) -> str:
        """Return the class in HTML: a picture may be too wide to be read on half a page."""
        pictures = [each.png for each in self.blocks if isinstance(each, Picture)]
        if not pictures:
            return "tables"
        wide = any(
            int.from_bytes(png[16:20], "big") > _WIDE * int.from_bytes(png[20:24], "big")
            for png in pictures  # width and height, as PNG has them
        )
        return "beside wide" if wide else "beside"


@dataclass(frozen=True)
class Listing:
    """Text to be shown as it is, folded away in HTML under its title."""

    title: str
    text: str


@dataclass(frozen=True)
class Folded:
    """Blocks that are folded away in HTML under their title."""

    title: str
    blocks: Sequence["Block"]


Block = Heading | Paragraph | ReportTable | Tiles | Picture | SideBySide | Listing | Folded

_WIDE: Final = 2.6


def to_markdown(blocks: Sequence[Block]) -> str:
    """Return the blocks as Markdown; pictures are referred to by their source."""
    return "\n".join(_markdown(block) for block in blocks)


_MARKDOWN: Final = str.maketrans({"&": "&amp;", "<": "&lt;", "[": r"\["})
"""Escapes: Markdown passes HTML on to the browser, and names of files may hold anything."""


def _plain(text: str) -> str:
    """Return a text as one line of Markdown that holds neither HTML nor a link."""
    return " ".join(text.split()).translate(_MARKDOWN)


def _markdown(block: Block) -> str:
    match block:
        case Heading():
            text = f"{'#' * block.level} {_plain(block.text)}\n"
        case Paragraph():
            text = f"{_plain(block.text)}\n"
        case Tiles():
            rows = [(tile.title, tile.value, tile.note) for tile in block.tiles]
            text = _markdown_table(ReportTable(("", "", ""), rows))
        case Picture():
            caption = _plain(block.caption)
            text = f"![{caption}]({block.source})\n\n*{caption}*\n"
        case SideBySide():
            text = to_markdown(block.blocks)
        case Folded():
            text = f"## {_plain(block.title)}\n\n{to_markdown(block.blocks)}"
        case Listing():
            longest = max(map(len, re.findall("`+", block.text)), default=0)
            fence = "`" * max(3, 1 + longest)
            text = f"{_plain(block.title)}:\n\n{fence}\n{block.text.rstrip()}\n{fence}\n"
        case ReportTable():
            text = _markdown_table(block)
    return text


def _markdown_table(table: ReportTable) -> str:
    def line(cells: Sequence[str]) -> str:
        escaped = (_plain(cell).replace("|", r"\|") for cell in cells)
        return f"| {' | '.join(escaped)} |"

    rulers = ["---:" if numeric else "---" for numeric in numeric_columns(table)]
    lines = [line(table.columns), f"| {' | '.join(rulers)} |", *(line(row) for row in table.rows)]
    caption = f"{_plain(table.caption)}\n\n" if table.caption else ""
    return caption + "\n".join(lines) + "\n"


def numeric_columns(table: ReportTable) -> list[bool]:
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


def as_text(*tables: ReportTable) -> str:
    """Return tables as plain text of 80 columns."""
    from rich.console import Console

    console = Console(width=80, file=io.StringIO(), color_system=None, force_jupyter=False)
    with console.capture() as capture:
        console.print(as_rich(*tables))
    return capture.get().rstrip()


def as_rich(*tables: ReportTable) -> "Group":
    """Return tables for the terminal, one below the other, narrow enough for 80 columns.

    The words of a heading are on lines of their own. Words of headings and numbers are not broken,
    texts are.
    """
    from rich.align import Align, AlignMethod
    from rich.console import Group

    from mmt.core.output.tables import plain_table

    shown: list[RenderableType] = []
    for table in tables:
        result = plain_table(padding=0)
        for place, numeric in enumerate(numeric_columns(table)):
            name = table.columns[place]
            side: AlignMethod = "right" if numeric else "left"
            whole = [*name.split(), *(row[place] for row in table.rows if numeric)]
            result.add_column(
                Align(name.replace(" ", "\n"), side, vertical="bottom"),
                justify=side,
                no_wrap=numeric,
                min_width=max(map(len, whole), default=1),
                overflow="fold",
            )
        for row in table.rows:
            result.add_row(*row)
        shown += [result, table.caption] if table.caption else [result]
    return Group(*shown)
