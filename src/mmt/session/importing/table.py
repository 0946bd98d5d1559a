"""Rows of cells, as in CSV files and spreadsheets, become columns of numbers."""

import re
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, islice
from typing import Final, TypeAlias

import numpy as np

from mmt.core.errors import InputError
from mmt.session.importing.columns import Columns
from mmt.session.importing.options import UNITS, unit_factor

Cell: TypeAlias = str | float | None

_LOOKED_AT = 200
"""Rows in which the header is looked for."""
_SHOWN_CHARACTERS: Final = 40
_UNIT = re.compile(r"^(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]$")
"""A name with a unit in brackets behind it."""


def read_table(
    origin: str,
    rows: Iterable[Sequence[Cell]],
    wanted: Callable[[str], bool],
    *,
    decimal_comma: bool = False,
) -> Columns:
    """Return the wanted columns of a table.

    The header is the row above the first row of numbers; a row of units between them is
    understood, and so is a unit in brackets behind a name. Without a header the columns are
    named "1", "2" and on. Empty cells are NaN, those at a column's end are left out: a
    column may end before the others.

    Raises
    ------
    InputError
        The table is empty, or a cell of a wanted column is not a number.
    """
    start, rest = _split(rows)
    if not start:
        raise InputError(f"{origin}: the file is empty")
    header, units_row, first = _header(start, decimal_comma)
    named = [_name_and_unit(cell) for cell in header]
    units = {name: unit for name, unit in named if unit}
    units |= {
        name: _text(unit).strip("[]() ")
        for (name, _), unit in zip(named, units_row, strict=False)
        if _text(unit)
    }
    places = {name: place for place, (name, _) in enumerate(named) if wanted(name)}
    numbers = {name: array("d") for name in places}
    for line, row in enumerate(chain(start[first:], rest), start=first + 1):
        for name, place in places.items():
            cell = row[place] if place < len(row) else None
            if cell is None or cell == "":
                continue
            column = numbers[name]
            lacking = line - first - 1 - len(column)
            if lacking:
                column.extend([np.nan] * lacking)
            try:
                column.append(float(cell) if not decimal_comma else _with_comma(cell))
            except (TypeError, ValueError) as error:
                if not _text(cell):
                    continue
                raise InputError(
                    f"{origin}: {name} is {_text(cell)[:_SHOWN_CHARACTERS]!r} in line {line}, it "
                    "must be a number"
                ) from error
    return Columns(
        origin=origin,
        values={name: np.array(values) for name, values in numbers.items()},
        names=[name for name, _ in named],
        units=units,
        row_name=lambda row: f"line {row + first + 1}",
    )


def _split(rows: Iterable[Sequence[Cell]]) -> tuple[list[Sequence[Cell]], Iterator[Sequence[Cell]]]:
    iterator = iter(rows)
    return list(islice(iterator, _LOOKED_AT)), iterator


def _header(
    rows: Sequence[Sequence[Cell]], decimal_comma: bool
) -> tuple[Sequence[Cell], Sequence[Cell], int]:
    """Return the row of names, the row of units, and the place of the first row of numbers."""
    first = next((n for n, row in enumerate(rows) if _is_data(row, decimal_comma)), None)
    if first is None:  # names alone
        named = next((n for n, row in enumerate(rows) if any(map(_text, row))), 0)
        return rows[named], (), named + 1
    above = [row for row in rows[:first] if any(map(_text, row))]
    if not above:
        return [str(number + 1) for number in range(len(rows[first]))], (), first
    if len(above) > 1 and _is_units(above[-1]):
        return above[-2], above[-1], first
    return above[-1], (), first


def _is_data(row: Sequence[Cell], decimal_comma: bool) -> bool:
    """Whether at least half of the cells that are filled are numbers."""
    filled = [cell for cell in row if _text(cell)]
    return bool(filled) and 2 * sum(_is_number(cell, decimal_comma) for cell in filled) >= len(
        filled
    )


def _is_units(row: Sequence[Cell]) -> bool:
    """Whether most filled cells are units; a dash stands for none."""
    texts = [_text(cell).strip("[]() ") for cell in row if _text(cell)]
    known = [
        text in ("-", "") or any(unit_factor(quantity, text) is not None for quantity in UNITS)
        for text in texts
    ]
    return 2 * sum(known) > len(known)


def _is_number(cell: Cell, decimal_comma: bool) -> bool:
    try:
        _with_comma(cell) if decimal_comma else float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return False
    return True


def _with_comma(cell: Cell) -> float:
    return float(cell.replace(",", ".") if isinstance(cell, str) else cell)  # type: ignore[arg-type]


def _name_and_unit(cell: Cell) -> tuple[str, str]:
    text = _text(cell)
    found = _UNIT.match(text)
    return (found.group(1), found.group(2)) if found and found.group(1) else (text, "")


def _text(cell: Cell) -> str:
    return "" if cell is None else str(cell).strip()
