"""Convert rows of cells, from text and spreadsheets, to columns of numbers."""

from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import chain, count
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError
from mmt.core.units import DATE
from mmt.session.importing.columns import BEGAN, SourceColumns, parsed_date
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import Cell, Numbers, seconds_of, text_of
from mmt.session.importing.readers.header import (
    Header,
    count_filled,
    find_numbers,
    is_setting,
    names_in,
    read_header,
    title_in,
)
from mmt.session.importing.samples import name_of

_SHOWN_CHARACTERS: Final = 40
_SHOWN_LINES: Final = 8
_FEW: Final = 0.01
"""Largest share of rows that count as damaged."""


def read_table(
    rows: Iterable[Sequence[Cell]], wanted: Callable[[str], bool], options: ImportOptions
) -> SourceColumns:
    """Return the wanted columns of a table.

    The header is the row above the first row of numbers and any settings of the columns such as
    ``10 V``, or the row that the options name.
    Units are read from a row between the two, or from brackets after a name. Without a header the
    columns are named "1", "2" and on. Cells without a value become NaN, but are left out at a
    column's end: columns may differ in length. Dates become seconds since 1970, times of day
    seconds since midnight. Equal names get the name above them, as ``tip.X``. Skipped are lines of
    text between the numbers, few lines of another number of cells, a cut-off last line, and a
    second table below.

    Raises
    ------
    InputError
        The table is empty, or a cell of a wanted column is not a number.
    """
    start, rest, first = find_numbers(rows, options)
    if not any(map(count_filled, start)):
        raise InputError("the file is empty")
    header = read_header(start, first, options)
    below = start[header.begin :]
    places = {name: place for name, place in header.places.items() if wanted(name)}
    number = Numbers(options)
    unnamed = {name: place for place, name in enumerate(header.names) if name == str(place + 1)}
    codes = {} if first is None else _codes(unnamed | places, below, number)
    places |= {name: unnamed[name] for name in codes if name not in places}
    read: dict[str, Callable[[Cell], float | None]] = {
        name: partial(_coded, codes[name]) if name in codes else partial(number, column=name)
        for name in places
    }
    columns, lines, notes = _read_rows(chain(below, rest), header, places, read, number)
    labels = {name: np.array([unit]) for name, unit in header.stated.items() if wanted(name)} | {
        name: np.array([*texts, ""])[np.nan_to_num(columns.pop(name), nan=-1).astype(int)]
        for name, texts in codes.items()
    }
    number.check()
    in_cells = {n: number.unit_in(n, np.asarray(values)) for n, values in columns.items()}
    told = {name: unit for name, unit in in_cells.items() if unit}
    dated = [
        n
        for n, p in places.items()
        if any(p < len(row) and seconds_of(row[p]) is not None for row in below)
    ]
    return SourceColumns(
        values={name: values for name, values in columns.items() if name != BEGAN},
        names=header.names,
        units={**header.units, **told, **dict.fromkeys(dated, DATE)},
        row_name=partial(name_of, "line {}".format, lines),
        ends_left_out=True,
        notes=(*header.notes, *notes),
        began_utc_ns=parsed_date(columns.get(BEGAN)),
        labels=labels,
    )


def _codes(
    places: Mapping[str, int], rows: Sequence[Sequence[Cell]], number: Numbers
) -> dict[str, defaultdict[str, int]]:
    """Return an empty code for each column that has texts only in the first rows."""
    cells = {n: [row[place] for row in rows if place < len(row)] for n, place in places.items()}
    return {
        name: defaultdict[str, int](count().__next__)
        for name, shown in cells.items()
        if not any(map(number.reads, shown)) and not all(map(number.takes, shown))
    }


def _coded(code: Mapping[str, int], cell: Cell) -> float | None:
    return code[text] if (text := text_of(cell)) else None


def _read_rows(
    rows: Iterable[Sequence[Cell]],
    header: Header,
    places: Mapping[str, int],
    read: Mapping[str, Callable[[Cell], float | None]],
    number: Numbers,
) -> tuple[dict[str, FloatArray], IntArray, list[str]]:
    """Return the numbers by column, the line number of each row, and notes on skipped lines."""
    columns = {name: array("d") for name in places}
    lines, widths, texts, notes = array("q"), array("q"), [], []
    below = ""
    names: Sequence[str] = ()
    title = ""
    for line, row in enumerate(rows, start=header.begin + 1):
        if is_setting(row):
            texts.append(line)
            continue
        cells = [row[place] if place < len(row) else None for place in places.values()]
        values: list[float | None] = []
        try:
            for name, cell in zip(places, cells, strict=True):
                values.append(read[name](cell))
        except ValueError as error:
            if not any(number.reads(cell) for cell in row):
                texts.append(line)
                below = below or next(filter(None, map(text_of, row)), "")
                names = names_in(row) or names
                title = title_in(row) or title
                continue
            raise InputError(
                f"{name} is {text_of(cell)[:_SHOWN_CHARACTERS]!r} in line {line}, it "
                "must be a number, or a date as 2026-01-31 10:30:00.5; --missing says what is none"
            ) from error
        if not row:
            continue
        if (names and widths and len(names) in (count_filled(row), len(row))) and (
            title not in ("", *header.titles) or names != header.own[: widths[-1]]
        ):
            told = "it was left out, as all below; --header with the line of its names reads it"
            notes.append(f"another table begins above line {line}: {told}")
            break
        names, title = (), ""
        for column, value in zip(columns.values(), values, strict=True):
            if value is not None:
                column.extend([np.nan] * (len(lines) - len(column)))
                column.append(value)
        lines.append(line)
        widths.append(len(row))
    if texts and not lines:
        raise InputError(
            f"below the names no line holds numbers alone; the first, line {texts[0]}, "
            f"begins with {below[:_SHOWN_CHARACTERS]!r}: numbers are written as 0.5 or 5e-1, with "
            "their unit in the header"
        )
    if texts:
        notes.append(f"{len(texts)} lines of text were left out, the first is line {texts[0]}")
    damaged = _damaged(np.array(widths))
    notes += _of_damage([lines[row] for row in damaged.tolist()], lines[-1] if lines else 0)
    left = {
        name: np.delete(column, damaged[damaged < len(column)]) for name, column in columns.items()
    }
    return left, np.delete(lines, damaged), notes


def _of_damage(damaged: Sequence[int], last: int) -> list[str]:
    """Return a note on damaged lines, if there are any."""
    if not damaged:
        return []
    if damaged[0] == last:
        return [f"the last line, {last}, is cut off, and was left out"]
    shown = ", ".join(map(str, damaged[:_SHOWN_LINES]))
    return [f"{len(damaged)} lines have more or fewer cells and were left out: {shown}"]


def _damaged(widths: IntArray) -> IntArray:
    """Return the rows of another number of cells than most, if they are few and among the others.

    Many such rows, or several at the end, are columns that have other rates or lengths.
    """
    usual = int(np.bincount(widths).argmax()) if len(widths) > 1 else 0
    others = np.flatnonzero(widths != usual)
    inside = others[others < np.max(np.flatnonzero(widths == usual), initial=0)]
    if len(others) == 1 and others[0] == len(widths) - 1 and widths[-1] < usual:
        return others
    return inside if len(inside) <= _FEW * len(widths) else inside[:0]
