"""Convert rows of cells, from text and spreadsheets, to columns of numbers."""

import re
from array import array
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, count, islice, zip_longest
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError
from mmt.core.units import DATE, is_unit, unit_factor
from mmt.session.importing.column_names import gives_unit, target_of
from mmt.session.importing.columns import BEGAN, SourceColumns, distinct, parsed_date
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import MISSING, Cell, Numbers, seconds_of, text_of
from mmt.session.importing.samples import name_of

_LOOKED_AT = 200
"""Number of rows that are examined to find the first row of numbers."""
_SHOWN_CHARACTERS: Final = 40
_SHOWN_LINES: Final = 8
_FEW: Final = 0.01
"""Largest share of rows that count as damaged."""
_NAMES_NEAR: Final = 6
"""Number of rows in which the names follow notes that look like numbers."""
_FEWEST_NAMES = 3
"""Least number of columns for which a first row 0, 1, ... or 1, 2, ... is taken for names."""
_UNIT_LINE: Final = re.compile(r"(.*units?)\s*(?:[:=]\s*(.*))?", re.IGNORECASE)
_LONGEST_NOTE: Final = 1000
"""Most characters of a line above a table in which units and factors are looked for."""
_UNIT_IN_NOTE: Final = re.compile(
    r"\b([^\W\d_]+)(?: is| are|:)? in [\[(]?([^\s\])]+?)[\])]?[,.;]?(?=\s|$)"
)
"""A quantity and its unit, as ``force in mN``."""
_FACTOR: Final = re.compile(
    r"\b(?:scal(?:e|ing)|factor|gain|multiplier|sensitivity)\b\D*?(\d*\.?\d+(?:e[-+]?\d+)?)", re.I
)
_QUANTITY: Final = re.compile(r"[-+±]?[\d.,]+\s*([^\d\s].*)")


def read_table(
    origin: str,
    rows: Iterable[Sequence[Cell]],
    wanted: Callable[[str], bool],
    options: ImportOptions,
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
    start, rest, first = _split(rows, options)
    if not any(map(_filled, start)):
        raise InputError(f"{origin}: the file is empty")
    header = _header(start, first, options)
    begin = header.begin
    header = header._replace(titles=tuple(map(_title_in, start[:begin])))
    bare, bracketed = zip(*map(_name_and_unit, header.names), strict=True)
    names, doubled = distinct(_grouped(bare, header.over))
    above = [row for row in start[:begin] if row is not header.units]
    labelled = (["", *row[1:]] for row in above if _are_labelled_units(row, len(names)))
    told = [text_of(unit) for unit in (header.units or next(labelled, ()))[: len(names)]]
    units: dict[str, str] = {}
    places: dict[str, int] = {}
    for called in (distinct(bare)[0], names):  # equal names can also be told by their number
        units |= {name: unit for name, unit in zip(called, bracketed, strict=True) if unit}
        units |= {
            name: unit.strip("[]() ")
            for name, unit in zip(called, told, strict=False)
            if unit.lower() not in MISSING and unit[-1] not in "=:"
        }
        places |= {name: place for place, name in enumerate(called) if wanted(name)}
    number = Numbers(options)
    unnamed = {name: place for place, name in enumerate(names) if name == str(place + 1)}
    codes = {} if first is None else _codes(unnamed | places, start[begin:], number)
    places |= {name: unnamed[name] for name in codes if name not in places}
    read: dict[str, Callable[[Cell], float | None]] = {
        name: partial(_coded, codes[name]) if name in codes else partial(number, column=name)
        for name in places
    }
    whole = chain(start[begin:], rest)
    columns, lines, remarks = _read_rows(origin, whole, header, places, read, number)
    stated = {n: np.array([unit]) for n, unit in _stated_units(above).items() if wanted(n)}
    labels = stated | {
        name: np.array([*texts, ""])[np.nan_to_num(columns.pop(name), nan=-1).astype(int)]
        for name, texts in codes.items()
    }
    number.check(origin)
    in_cells = {n: number.unit_in(n, np.asarray(values), origin) for n, values in columns.items()}
    units |= {name: unit for name, unit in in_cells.items() if unit}
    dated = [n for n, p in places.items() if any(_is_date(row, p) for row in start[begin:])]
    return SourceColumns(
        origin=origin,
        values={name: values for name, values in columns.items() if name != BEGAN},
        names=names,
        units=units | dict.fromkeys(dated, DATE),
        row_name=partial(name_of, "line {}".format, lines),
        ends_left_out=True,
        notes=(*header.notes, *doubled, *_factors_in(start[:begin]), *remarks),
        began_utc_ns=parsed_date(columns.get(BEGAN), origin),
        labels=labels,
    )


def _stated_units(rows: Sequence[Sequence[Cell]]) -> dict[str, str]:
    """Return the units by name in lines above a table: ``Length Units,Meters``, ``force in mN``."""
    texts = [list(map(text_of, row)) for row in rows]
    in_notes = (match for row in texts for match in _UNIT_IN_NOTE.findall(_note(row)))
    known = {f"{word} units": unit for word, unit in in_notes if is_unit(unit)}
    pairs = (pair for row in texts for pair in zip(row, [*row, ""][1:], strict=True))
    found = ((_UNIT_LINE.fullmatch(cell), following) for cell, following in pairs)
    told = ((match[1], match[2] or following) for match, following in found if match)
    named = {name: unit for name, unit in told if unit}
    return {name: unit for name, unit in (known | named).items() if gives_unit(name)}


def _factors_in(rows: Sequence[Sequence[Cell]]) -> Iterator[str]:
    """Yield a sentence for each line above a table that states a factor, which is not applied."""
    for number, row in enumerate(rows, start=1):
        note = _note(row)
        match = _FACTOR.search(note)
        if match and float(match[1]) != 1:
            scaled = f"--map TARGET=COLUMN*{match[1]}"
            yield f"line {number}, {note!r}, was not applied: {scaled} does so"


def _note(row: Sequence[Cell]) -> str:
    return " ".join(filter(None, map(text_of, row)))[:_LONGEST_NOTE]


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
    origin: str,
    rows: Iterable[Sequence[Cell]],
    header: "_Header",
    places: Mapping[str, int],
    read: Mapping[str, Callable[[Cell], float | None]],
    number: Numbers,
) -> tuple[dict[str, FloatArray], IntArray, list[str]]:
    """Return the numbers by column, the line number of each row, and notes on skipped lines."""
    columns = {name: array("d") for name in places}
    lines, widths, texts, notes = array("q"), array("q"), [], []
    own, below = _given_names(header), ""
    names: Sequence[str] = ()
    title = ""
    for line, row in enumerate(rows, start=header.begin + 1):
        cells = [row[place] if place < len(row) else None for place in places.values()]
        values: list[float | None] = []
        try:
            for name, cell in zip(places, cells, strict=True):
                values.append(read[name](cell))
        except ValueError as error:
            if not any(number.reads(cell) for cell in row):
                texts.append(line)
                below = below or next(filter(None, map(text_of, row)), "")
                names = _names_in(row) or names
                title = _title_in(row) or title
                continue
            raise InputError(
                f"{origin}: {name} is {text_of(cell)[:_SHOWN_CHARACTERS]!r} in line {line}, it "
                "must be a number, or a date as 2026-01-31 10:30:00.5; --missing says what is none"
            ) from error
        if not row:
            continue
        if (names and widths and len(names) == _filled(row)) and (
            title not in ("", *header.titles) or names != own[: widths[-1]]
        ):
            notes.append(f"another table begins above line {line}: it was left out, as all below")
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
            f"{origin}: below the names no line holds numbers alone; the first, line {texts[0]}, "
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


def _split(
    rows: Iterable[Sequence[Cell]], options: ImportOptions
) -> tuple[list[Sequence[Cell]], Iterator[Sequence[Cell]], int | None]:
    """Return the first rows, an iterator over the rest, and the index of the first numbers."""
    rest, least = iter(rows), options.header or 0
    start = list(islice(rest, least + _LOOKED_AT))
    for number in (Numbers(options, plain=True), Numbers(options)):  # settings have units
        place = least
        while place < len(start):
            if _is_data(start[place : place + _LOOKED_AT], number):
                while place > least and _begins(start[place - 1], start[place], number):
                    place -= 1
                return start, rest, place
            place += 1
            start.extend(islice(rest, 1))
    return start, rest, None


class _Header(NamedTuple):
    """Rows of names, of names above them and of units; the index of the first row of numbers."""

    names: Sequence[Cell]
    begin: int
    over: Sequence[Cell] = ()
    units: Sequence[Cell] = ()
    notes: tuple[str, ...] = ()
    titles: tuple[str, ...] = ()
    """Lines above with a single text."""


def _header(rows: Sequence[Sequence[Cell]], first: int | None, options: ImportOptions) -> _Header:
    """Return the header above the row `first` of numbers; None if there is no such row."""
    if options.header is not None:
        if options.header > len(rows) or not _filled(rows[options.header - 1]):
            raise InputError(f"--header {options.header}: there is nothing in this line")
        begin = options.header if first is None else first
        below = rows[options.header : begin]
        return _Header(rows[options.header - 1], begin, units=next(filter(_is_units, below), ()))
    if first is None:  # no numbers, only names
        named = next(n for n, row in enumerate(rows) if _filled(row))
        return _Header(rows[named], named + 1)
    width = len(rows[first])
    above = [row for row in rows[:first] if _filled(row)]
    index: Sequence[Cell] = ()  # pandas writes its name below the others
    while above and 2 * _filled(above[-1]) <= _filled(rows[first]):
        index = above.pop()
    if above:
        units: Sequence[Cell] = ()
        while len(above) > 1 and (_is_units(above[-1]) or _is_settings(above[-1])):
            row = above.pop()
            units = units or (row if _is_units(row) else ())
        over = above[-2] if len(above) > 1 else ()  # its names fill blanks in the row below
        wide = max(width, len(above[-1]))
        cells = zip_longest(above[-1], over[:wide], index[:wide], range(1, wide + 1))
        each = [tuple(map(text_of, column)) for column in cells]
        names = [_named(*texts) for texts in each]
        if len(above[-1]) == width - 1 and _are_counted(rows[first:]):
            return _Header(["", *names[:-1]], first, units=units)
        return _Header(names, first, over, units)
    texts = list(map(text_of, rows[first]))
    counted = [[str(start + place) for place in range(width)] for start in (0, 1)]
    if width >= _FEWEST_NAMES and texts in counted and len(rows) > first + 1:
        note = f"line {first + 1}, {texts[0]} to {texts[-1]}, was taken for the columns' names"
        return _Header(rows[first], first + 1, notes=(note,))
    return _Header(counted[1], first)


def _named(name: str, group: str, *others: str) -> str:
    """Return the first text that is a name; with the unit of time below that of a time."""
    if group and unit_factor("time", name) and target_of(group) == "time":
        return f"{group} [{name}]"
    return next(text for text in (name, group, *others) if text and text[-1] != "=")


def _grouped(names: Sequence[str], over: Sequence[Cell]) -> list[str]:
    """Return names, equal ones with the name above them, or the nearest one to the left of it."""
    counts, group, found = Counter(names), "", []
    for name, above in zip_longest(names, map(text_of, over[: len(names)]), fillvalue=""):
        group = above or group
        found.append(f"{group}.{name}" if group and counts[name] > 1 else name)
    return found


def _are_counted(rows: Sequence[Sequence[Cell]]) -> bool:
    """Return whether rows begin with their number, which has no name, as R writes them."""
    filled = [list(map(text_of, row)) for row in rows if _filled(row)]
    return len(filled) > 1 and all(
        row[0] == str(number) and row[-1] for number, row in enumerate(filled, start=1)
    )


def _begins(row: Sequence[Cell], following: Sequence[Cell], number: Numbers) -> bool:
    """Return whether a row before one of numbers is of them, too, with some values missing."""
    numbers = any(map(number.reads, row)) and all(map(number.takes, row))
    return numbers and len(row) == len(following)


def _is_data(rows: Sequence[Sequence[Cell]], number: Numbers) -> bool:
    """Return whether the first row consists of numbers as most of the following rows do."""

    def places(row: Sequence[Cell]) -> set[int]:
        return {place for place, cell in enumerate(row) if number.reads(cell)}

    if not places(rows[0]):
        return False
    rows = [row for row in rows if _filled(row)]
    widths = Counter(map(len, rows))
    if widths[len(rows[0])] < max(widths.values()):
        return False
    counts = Counter(place for row in rows for place in places(row))
    mostly = {place for place, count in counts.items() if 2 * count > len(rows)}
    filled = {place for place in mostly if place < len(rows[0]) and text_of(rows[0][place])}
    near = [row for row in rows[1:_NAMES_NEAR] if _filled(row) > 1 and not places(row)]
    if near and not all(number.takes(rows[0][place]) for place in filled):
        return False
    return 2 * len(filled) >= len(mostly) and 2 * len(places(rows[0]) & filled) > len(filled)


def _given_names(header: _Header) -> list[str]:
    """Return the names in a header without the numbers of blanks at its end."""
    names = list(map(text_of, header.names))
    while names and names[-1] == str(len(names)):
        names.pop()
    return names


def _names_in(row: Sequence[Cell]) -> list[str]:
    """Return the texts of a row of text that may be names for rows below, or none."""
    texts = list(filter(None, map(text_of, row)))
    return texts if 1 < len(texts) == len(set(texts)) and not _is_units(row) else []


def _title_in(row: Sequence[Cell]) -> str:
    """Return the text of a row that has no other, as above a table; not a comment's sign."""
    texts = list(filter(None, map(text_of, row)))
    return texts[0] if len(texts) == 1 and texts[0] not in "#%" else ""


def _is_units(row: Sequence[Cell]) -> bool:
    """Return whether most non-empty cells are units, or dashes for no unit."""
    texts = [text_of(cell).strip("[]() ") for cell in row if text_of(cell)]
    return 2 * sum(text in ("-", "") or is_unit(text) for text in texts) > len(texts)


def _are_labelled_units(row: Sequence[Cell], width: int) -> bool:
    """Return whether a row above the names has units behind a word, as LabVIEW writes them."""
    texts = list(filter(None, map(text_of, row)))
    all_units = len(texts) > 1 and "unit" in texts[0].lower() and all(map(is_unit, texts[1:]))
    return all_units and width - 1 <= len(texts) <= width


def _is_settings(row: Sequence[Cell]) -> bool:
    """Return whether most non-empty cells are quantities, as the range of each channel is."""
    found = [_QUANTITY.fullmatch(text) for text in map(text_of, row) if text]
    return 2 * sum(each is not None and is_unit(each[1]) for each in found) > len(found)


def _is_date(row: Sequence[Cell], place: int) -> bool:
    return place < len(row) and seconds_of(row[place]) is not None


def _name_and_unit(cell: Cell) -> tuple[str, str]:
    """Split a name and its unit in brackets; an index or axis in brackets is part of the name."""
    text = text_of(cell)
    inside = text[:-1]
    start = max(inside.rfind("]"), inside.rfind(")")) + 1
    opened = min((at for at in map(inside[start:].find, "[(") if at >= 0), default=-1) + start
    name, unit = inside[:opened].rstrip(), inside[opened + 1 :].strip()
    if not text.endswith(("]", ")")) or opened < start or not name:
        return text, ""
    is_unit = bool(unit.strip("0123456789 \t")) and unit.lower() not in {"x", "y", "z"}
    return (name, unit) if is_unit else (text, "")


def _filled(row: Sequence[Cell]) -> int:
    return sum(bool(text_of(cell)) for cell in row)
