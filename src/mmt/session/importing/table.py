"""Rows of cells, as in text and spreadsheets, become columns of numbers."""

import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, date, datetime, time, timedelta
from itertools import chain, islice
from typing import Final, TypeAlias

import numpy as np

from mmt.core.errors import InputError
from mmt.session.importing.columns import Columns, distinct
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.units import DATE, is_unit

Cell: TypeAlias = str | float | date | time | timedelta | None

_LOOKED_AT = 200
"""Rows by which it is told whether another is the first of the numbers."""
_SHOWN_CHARACTERS: Final = 40
_FEWEST_NAMES = 3
"""Whole numbers in the first row, from 0 or 1 on, that are names."""
_UNIT = re.compile(r"^(.*?)\s*[\[(]\s*([^\])]*?[^\s\d\])][^\])]*?)\s*[\])]$")
"""A name with a unit in brackets behind it; a number there is an index, and part of the name."""
_MISSING: Final = frozenset(
    ("", "na", "n/a", "#n/a", "#na", "#nv", "nan", "null", "none", "nil", "-", "--", "---", "?")
)
_DATES: Final = ("%d.%m.%Y %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S", "%M:%S.%f")


def read_table(
    origin: str,
    rows: Iterable[Sequence[Cell]],
    wanted: Callable[[str], bool],
    options: ImportOptions,
) -> Columns:
    """Return the wanted columns of a table.

    The header is the row above the first row of numbers, or the one that the options name; a row
    of units between them is understood, and so is a unit in brackets behind a name. Without a
    header the columns are named "1", "2" and on. Cells without a value are NaN, those at a
    column's end are left out: a column may end before the others. A date is in seconds since
    1970, a time of day since midnight. Where the header stands again, it is left out.

    Raises
    ------
    InputError
        The table is empty, or a cell of a wanted column is not a number.
    """
    start, rest, first = _split(rows, options)
    if not any(map(_filled, start)):
        raise InputError(f"{origin}: the file is empty")
    header, units_row, first, notes = _header(start, first, options)
    bare, bracketed = zip(*map(_name_and_unit, header), strict=True)
    names, doubled = distinct(bare)
    units = {name: unit for name, unit in zip(names, bracketed, strict=True) if unit}
    for name, unit in zip(names, map(_text, units_row), strict=False):
        if unit.lower() not in _MISSING:
            units[name] = unit.strip("[]() ")
    places = {name: place for place, name in enumerate(names) if wanted(name)}
    columns = {name: array("d") for name in places}
    lines = array("q")
    number, again = _numbers(options), 0
    for line, row in enumerate(chain(start[first:], rest), start=first + 1):
        if not row:
            continue
        for name, place in places.items():
            cell = row[place] if place < len(row) else None
            try:
                value = None if cell is None or cell == "" else number(cell)
            except ValueError as error:
                if list(map(_text, row)) in (list(map(_text, header)), list(map(_text, units_row))):
                    again += 1
                    break
                raise InputError(
                    f"{origin}: {name} is {_text(cell)[:_SHOWN_CHARACTERS]!r} in line {line}, it "
                    "must be a number, or a date as 2026-01-31 10:30:00.5; --missing says what "
                    "stands for no value"
                ) from error
            if value is not None:
                columns[name].extend([np.nan] * (len(lines) - len(columns[name])))
                columns[name].append(value)
        else:
            lines.append(line)
    if again:
        notes.append(f"the header stands {again + 1} times in it: the recorder was started anew")
    dated = [n for n, p in places.items() if any(_is_date(row, p) for row in start[first:])]
    return Columns(
        origin=origin,
        values={name: np.array(values) for name, values in columns.items()},
        names=names,
        units=units | dict.fromkeys(dated, DATE),
        row_name=lambda row: f"line {lines[row]}",
        notes=(*notes, *doubled),
    )


def _split(
    rows: Iterable[Sequence[Cell]], options: ImportOptions
) -> tuple[list[Sequence[Cell]], Iterator[Sequence[Cell]], int | None]:
    """Return the first rows, those that follow, and the place of the first row of numbers."""
    rest = iter(rows)
    start = list(islice(rest, (options.header or 0) + _LOOKED_AT))
    place = options.header or 0
    number = _numbers(options)
    while place < len(start):
        if _is_data(start[place : place + _LOOKED_AT], number):
            return start, rest, place
        place += 1
        start.extend(islice(rest, 1))
    return start, rest, None


def _header(
    rows: Sequence[Sequence[Cell]], first: int | None, options: ImportOptions
) -> tuple[Sequence[Cell], Sequence[Cell], int, list[str]]:
    """Return the row of names, the row of units, the place of the first row of numbers, notes."""
    if options.header is not None:
        if options.header > len(rows) or not _filled(rows[options.header - 1]):
            raise InputError(f"--header {options.header}: there is nothing in this line")
        begin = options.header if first is None else first
        units = next((row for row in rows[options.header : begin] if _is_units(row)), ())
        return rows[options.header - 1], units, begin, []
    if first is None:  # names alone
        named = next(n for n, row in enumerate(rows) if _filled(row))
        return rows[named], (), named + 1, []
    width = len(rows[first])
    above = [row for row in rows[:first] if 2 * _filled(row) > _filled(rows[first])]
    if above:
        is_units = len(above) > 1 and _is_units(above[-1])
        names = above[-2] if is_units else above[-1]
        extra = [str(place + 1) for place in range(len(names), width)]
        return [*names, *extra], above[-1] if is_units else (), first, []
    texts = list(map(_text, rows[first]))
    counted = [[str(start + place) for place in range(width)] for start in (0, 1)]
    if width >= _FEWEST_NAMES and texts in counted and len(rows) > first + 1:
        note = f"line {first + 1}, {texts[0]} to {texts[-1]}, was taken for the columns' names"
        return rows[first], (), first + 1, [note]
    return counted[1], (), first, []


def _is_data(rows: Sequence[Sequence[Cell]], number: Callable[[Cell], float | None]) -> bool:
    """Whether the first of these rows is one of numbers, as most that follow it are."""

    def places(row: Sequence[Cell]) -> set[int]:
        return {place for place, cell in enumerate(row) if _is_number(cell, number)}

    if not places(rows[0]):
        return False
    rows = [row for row in rows if _filled(row)]
    widths = Counter(map(len, rows))
    if widths[len(rows[0])] < max(widths.values()):
        return False
    counts = Counter(place for row in rows for place in places(row))
    mostly = {place for place, count in counts.items() if 2 * count > len(rows)}
    filled = {place for place in mostly if place < len(rows[0]) and _text(rows[0][place])}
    return 2 * len(filled) >= len(mostly) and 2 * len(places(rows[0]) & filled) > len(filled)


def _is_units(row: Sequence[Cell]) -> bool:
    """Whether most filled cells are units; a dash stands for none."""
    texts = [_text(cell).strip("[]() ") for cell in row if _text(cell)]
    return 2 * sum(text in ("-", "") or is_unit(text) for text in texts) > len(texts)


def _is_number(cell: Cell, number: Callable[[Cell], float | None]) -> bool:
    try:
        return cell is not None and cell != "" and number(cell) is not None
    except ValueError:
        return False


def _is_date(row: Sequence[Cell], place: int) -> bool:
    return place < len(row) and _seconds(row[place]) is not None


def weigh_numbers(rows: Iterable[Sequence[Cell]], options: ImportOptions) -> int:
    """Return how many more cells are numbers than are not, in the rows with numbers."""
    number, weight = _numbers(options), 0
    for row in rows:
        filled = [cell for cell in row if _text(cell)]
        numbers = sum(_is_number(cell, number) for cell in filled)
        weight += 2 * numbers - len(filled) if numbers else 0
    return weight


def _numbers(options: ImportOptions) -> Callable[[Cell], float | None]:
    """Return what makes a cell a number, None of one without; it raises ValueError for a text."""
    missing = _MISSING | {text.strip().lower() for text in options.missing}
    thousands = {".": ",", ",": "."}.get(options.decimal or "")

    def number(cell: Cell) -> float | None:
        if not isinstance(cell, str):
            seconds = _seconds(cell)
            return seconds if seconds is not None else number(str(cell))
        plain = None if options.missing or thousands else _float(cell)
        if plain is not None:
            return plain
        text = cell.strip()
        if text.lower() in missing:
            return None
        seconds = _seconds(text)
        if seconds is not None:
            return seconds
        if thousands:
            text = text.replace(thousands, "")
        return float(text if "." in text else text.replace(",", ".", 1))

    return number


def _float(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _seconds(cell: Cell) -> float | None:
    """Return the seconds of a date since 1970, of a time of day since midnight, None of others."""
    if isinstance(cell, str):
        cell = _moment(cell.strip().replace(",", "."))
    if isinstance(cell, timedelta):
        return cell.total_seconds()
    if isinstance(cell, time):
        return timedelta(
            hours=cell.hour, minutes=cell.minute, seconds=cell.second, microseconds=cell.microsecond
        ).total_seconds()
    if isinstance(cell, datetime):
        return (cell if cell.tzinfo else cell.replace(tzinfo=UTC)).timestamp()
    return None


def _moment(text: str) -> datetime | time | None:
    if ":" not in text:
        return None
    for read in (datetime.fromisoformat, time.fromisoformat):
        try:
            return read(text)
        except ValueError:
            continue
    for form in _DATES:
        try:
            return datetime.strptime(text, form).replace(tzinfo=UTC)
        except ValueError:
            continue
    return None


def _name_and_unit(cell: Cell) -> tuple[str, str]:
    text = _text(cell)
    found = _UNIT.match(text)
    return (found.group(1), found.group(2)) if found and found.group(1) else (text, "")


def _filled(row: Sequence[Cell]) -> int:
    return sum(bool(_text(cell)) for cell in row)


def _text(cell: Cell) -> str:
    return "" if cell is None else str(cell).strip()
