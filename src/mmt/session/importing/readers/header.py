"""The rows above the numbers of a table: names of columns, their units, and notes."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, islice, zip_longest
from typing import Final, NamedTuple

from mmt.core.errors import InputError
from mmt.core.units import is_unit, unit_factor
from mmt.session.importing.column_names import gives_unit, target_of
from mmt.session.importing.columns import distinct
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import MISSING, Cell, Numbers, text_of

_LOOKED_AT = 200
"""Number of rows that are examined to find the first row of numbers."""
_NAMES_NEAR: Final = 6
"""Number of rows in which the names follow notes that look like numbers."""
_FEWEST_NAMES = 3
"""Least number of columns for which a first row 0, 1, ... or 1, 2, ... is taken for names."""
_UNIT_LINE: Final = re.compile(r"(.*units?)\s*(?:[:=]\s*(.*))?", re.IGNORECASE)
_SHIFTED: Final = (
    "line {} has {} cells, more than there are names: if the first has none, each name stands a "
    "cell too far to the left; then write one before them"
)
_NAMES_LEFT: Final = (
    "there are {} names for {} columns, so they may stand at other columns than their own: write "
    "a sign between them that is in none, or take the line away and map columns by number"
)
_LONGEST_NOTE: Final = 1000
"""Most characters of a line above a table in which units and factors are looked for."""
_UNIT_IN_NOTE: Final = re.compile(
    r"\b([^\W\d_]+)(?: is| are|:)? in [\[(]?([^\s\])]+?)[\])]?[,.;]?(?=\s|$)"
)
"""A quantity and its unit, as ``force in mN``."""
_FACTOR: Final = re.compile(
    r"\b(?:scal(?:e|ing)|factor|gain|multiplier|(sensitivity|counts per \w+))\b\D*?"
    r"(\d*\.?\d+(?:e[-+]?\d+)?)", re.I
)  # fmt: skip
"""Matches a factor, or what a unit gives, by which values are divided."""
_QUANTITY: Final = re.compile(r"[-+±]?[\d.,]+\s*([^\d\s].*)")


class Header(NamedTuple):
    """The header of a table."""

    names: Sequence[str]
    """Names of the columns; equal ones have the name above them, as ``tip.X``."""
    places: Mapping[str, int]
    """Columns by name; equal names can also be told by their number."""
    units: Mapping[str, str]
    """Units by name, from a row of units or from brackets."""
    stated: Mapping[str, str]
    """Units from notes above, by what they are of: ``Length Units``."""
    begin: int
    """Index of the first row of numbers."""
    own: Sequence[str]
    """Names as they are written, without the numbers of blanks at the end."""
    titles: Sequence[str]
    """Lines above with a single text."""
    notes: Sequence[str]
    """Sentences for the person."""


def read_header(
    rows: Sequence[Sequence[Cell]], first: int | None, options: ImportOptions
) -> Header:
    """Return the header of a table from its first rows.

    `first` is the index of the first row of numbers, or None.

    Raises
    ------
    InputError
        The line that the options name for the header is empty.
    """
    found = _header_rows(rows, first, options)
    bare, bracketed = _names_and_units(found.names)
    names, doubled = distinct(_grouped(bare, found.over))
    above = [row for row in rows[: found.begin] if row is not found.units]
    in_rows = [_units_above(row, len(names)) for row in above]
    told = [text_of(unit) for unit in found.units or next(filter(None, in_rows), ())]
    units: dict[str, str] = {}
    places: dict[str, int] = {}
    for called in (distinct(bare)[0], names):
        units |= {name: unit for name, unit in zip(called, bracketed, strict=True) if unit}
        units |= {
            name: unit.strip("[]() ")
            for name, unit in zip(called, told, strict=False)
            if unit.lower() not in MISSING and unit[-1] not in "=:"
        }
        places |= {name: place for place, name in enumerate(called)}
    own = list(map(text_of, found.names))
    while own and own[-1] == str(len(own)):
        own.pop()
    return Header(
        names,
        places,
        units,
        _stated_units([row for row, used in zip(above, in_rows, strict=True) if not used]),
        found.begin,
        own=own,
        titles=[title_in(row) for row in rows[: found.begin]],
        notes=[*found.notes, *doubled, *_factors_in(rows[: found.begin])],
    )


def find_numbers(
    rows: Iterable[Sequence[Cell]], options: ImportOptions
) -> tuple[list[Sequence[Cell]], Iterator[Sequence[Cell]], int | None]:
    """Return the first rows, an iterator over the rest, and the index of the first numbers."""
    rest, least = iter(rows), options.header or 0
    start = list(islice(rest, least + _LOOKED_AT))
    for number in (Numbers(options, plain=True), Numbers(options)):  # settings have units
        places = list(map(number.places, start))
        row = least
        while row < len(start):
            if _is_data(start[row : row + _LOOKED_AT], places[row : row + _LOOKED_AT], number):
                while row > least and _begins(start[row - 1], start[row], number):
                    row -= 1
                return start, rest, row
            row += 1
            start.extend(islice(rest, 1))
            places.extend(map(number.places, start[len(places) :]))
    return start, rest, None


class _Rows(NamedTuple):
    """Rows of names, of names above them and of units; the index of the first row of numbers."""

    names: Sequence[Cell]
    begin: int
    over: Sequence[Cell] = ()
    units: Sequence[Cell] = ()
    notes: tuple[str, ...] = ()


def _header_rows(
    rows: Sequence[Sequence[Cell]], first: int | None, options: ImportOptions
) -> _Rows:
    """Return the rows of names and units above the row `first` of numbers."""
    if options.header is not None:
        if options.header > len(rows) or not count_filled(rows[options.header - 1]):
            raise InputError(f"--header {options.header}: there is nothing in this line")
        begin = options.header if first is None else first
        below = rows[options.header : begin]
        return _Rows(rows[options.header - 1], begin, units=next(filter(_is_units, below), ()))
    if first is None:  # no numbers, only names
        named = next(n for n, row in enumerate(rows) if count_filled(row))
        return _Rows(rows[named], named + 1)
    width = len(rows[first])
    above = [row for row in rows[:first] if count_filled(row)]
    index: Sequence[Cell] = ()  # pandas writes its name below the others
    while above and 2 * count_filled(above[-1]) <= count_filled(rows[first]):
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
        begins_late = _is_shifted([above[-1], *rows[first:]])
        names = [_named(*texts) for texts in each[int(begins_late) :]]
        if len(above[-1]) == width - 1 and _are_counted(rows[first:]):
            return _Rows(["", *names[:-1]], first, units=units)
        few = text_of(rows[first][-1]) and not any(each[width - 1][:-1])
        named, widest = count_filled(above[-1]), max(map(len, rows[first:]))
        told = _SHIFTED.format(first + 1, width) if few else ""
        told = _NAMES_LEFT.format(named, widest) if named > widest else told
        return _Rows(names, first, over, units, (told,) if told else ())
    texts = list(map(text_of, rows[first]))
    counted = [[str(start + place) for place in range(width)] for start in (0, 1)]
    if width >= _FEWEST_NAMES and texts in counted and len(rows) > first + 1:
        note = f"line {first + 1}, {texts[0]} to {texts[-1]}, was taken for the columns' names"
        return _Rows(rows[first], first + 1, notes=(note,))
    return _Rows(counted[1], first)


def _named(name: str, group: str, index: str, number: str) -> str:
    """Return the first text that is a name; with the unit of time below that of a time.

    The name of an index that is the time counts more than what pandas calls the levels of names.
    """
    if group and unit_factor("time", name) and target_of(group) == "time":
        return f"{group} [{name}]"
    texts = (index, name) if target_of(index) == "time" else (name, group, index, number)
    return next(text for text in texts if text and text[-1] != "=")


def _grouped(names: Sequence[str], over: Sequence[Cell]) -> list[str]:
    """Return names, equal ones with the name above them, or the nearest one to the left of it."""
    counts, group, found = Counter(names), "", []
    for name, above in zip_longest(names, map(text_of, over[: len(names)]), fillvalue=""):
        group = above or group
        found.append(f"{group}.{name}" if group and counts[name] > 1 else name)
    return found


def _are_counted(rows: Sequence[Sequence[Cell]]) -> bool:
    """Return whether rows begin with their number from 0 or 1, which has no name, as R writes."""
    filled = [list(map(text_of, row)) for row in rows if count_filled(row)]
    begin = int(filled[0][0] != "0")
    return len(filled) > 1 and all(
        row[0] == str(number) and row[-1] for number, row in enumerate(filled, start=begin)
    )


def _is_shifted(rows: Sequence[Sequence[Cell]]) -> bool:
    """Return whether names stand behind a blank that no row below has, that of a comment's sign."""
    (first, *names), widest = rows[0], max(map(len, rows[1:]))
    fits = len(names) == widest and not text_of(first) and bool(text_of(names[-1]))
    return fits and not _are_counted(rows[1:])


def _begins(row: Sequence[Cell], following: Sequence[Cell], number: Numbers) -> bool:
    """Return whether a row before one of numbers is of them, too, with some values missing."""
    numbers = any(map(number.reads, row)) and all(map(number.takes, row))
    return numbers and len(row) == len(following)


def _is_data(rows: Sequence[Sequence[Cell]], places: Sequence[set[int]], number: Numbers) -> bool:
    """Return whether the first row has numbers, at `places`, as most of the following rows do."""
    first, begin = rows[0], places[0]
    if not begin:
        return False
    filled = [place for place, row in enumerate(rows) if any(map(text_of, row))]
    widths = Counter(len(rows[place]) for place in filled)
    if widths[len(first)] < max(widths.values()):
        return False
    counts = Counter(chain.from_iterable(places[place] for place in filled))
    mostly = {place for place, count in counts.items() if 2 * count > len(filled)}
    known = {place for place in mostly if place < len(first) and text_of(first[place])}
    near = any(count_filled(rows[at]) > 1 and not places[at] for at in filled[1:_NAMES_NEAR])
    if near and not all(number.takes(first[place]) for place in known):
        return False
    return 2 * len(known) >= len(mostly) and 2 * len(begin & known) > len(known)


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
        if match and float(match[2]) not in (0, 1):
            factor = f"{1 / float(match[2]):.6g}" if match[1] else match[2]
            yield f"line {number}, {note!r}, was not applied: --map TARGET=COLUMN*{factor} does so"


def _note(row: Sequence[Cell]) -> str:
    return " ".join(filter(None, map(text_of, row)))[:_LONGEST_NOTE]


def is_setting(row: Sequence[Cell]) -> bool:
    """Return whether a row is one of settings, as ``Range=`` and that of each channel."""
    return bool(row) and text_of(row[0]).endswith("=")


def names_in(row: Sequence[Cell]) -> list[str]:
    """Return the texts of a row of text that may be names for rows below, or none."""
    texts = list(filter(None, map(text_of, row)))
    are_several = len(set(texts)) >= min(3, len(texts)) > 1  # X, Y, Z may be of several markers
    return texts if are_several and not _is_units(row) else []


def title_in(row: Sequence[Cell]) -> str:
    """Return the text of a row that has no other, as above a table; not a comment's sign."""
    texts = list(filter(None, map(text_of, row)))
    return texts[0] if len(texts) == 1 and texts[0] not in "#%" else ""


def _is_units(row: Sequence[Cell]) -> bool:
    """Return whether most non-empty cells are units, or dashes for no unit."""
    texts = [text_of(cell).strip("[]() ") for cell in row if text_of(cell)]
    return 2 * sum(text in ("-", "") or is_unit(text) for text in texts) > len(texts)


def _units_above(row: Sequence[Cell], width: int) -> list[str]:
    """Return the units in a row above the names, perhaps behind a word as in LabVIEW, else []."""
    first, *others = [*map(text_of, row), ""]
    texts = ["" if "unit" in first.lower() else first, *others]
    fits = max(2, width - 1) <= count_filled(row) <= width
    return texts[:width] if fits and all(map(is_unit, filter(None, texts))) else []


def _is_settings(row: Sequence[Cell]) -> bool:
    """Return whether most non-empty cells are quantities, as the range of each channel is."""
    found = [_QUANTITY.fullmatch(text) for text in map(text_of, row) if text]
    return 2 * sum(each is not None and is_unit(each[1]) for each in found) > len(found)


def _names_and_units(cells: Sequence[Cell]) -> tuple[list[str], list[str]]:
    """Split names and their units; names that only other words in brackets tell apart keep them."""
    pairs = list(map(_name_and_unit, cells))
    counts = Counter(name for name, _ in dict.fromkeys(pairs))
    whole = [counts[name] > 1 and bool(unit) and not is_unit(unit) for name, unit in pairs]
    names = [text_of(c) if w else n for c, w, (n, _) in zip(cells, whole, pairs, strict=True)]
    return names, [unit for _, unit in pairs]


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


def count_filled(row: Sequence[Cell]) -> int:
    """Return the number of cells with text."""
    return sum(bool(text_of(cell)) for cell in row)
