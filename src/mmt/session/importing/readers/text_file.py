"""Read tables in text files: any separator and encoding, decimal point or comma, also gzip."""

import csv
import gzip
import json
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import Any, Final, TextIO

from mmt.core.errors import InputError
from mmt.session.importing.column_names import target_of
from mmt.session.importing.columns import SourceColumns, reading
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import weigh_numbers
from mmt.session.importing.readers.table import read_table

_LOOKED_AT = 300
_SIGNS: Final = ";\t|, "
_LONGEST_LINE: Final = 1 << 20
"""Number of characters; cells take many times more memory than their text."""
_VECTOR: Final = re.compile(
    r"(?:(?:np\.|numpy\.)?(?:array|tensor)\()?[\[(]\s*([-+\d.][^\[\]()]*)[\])](?:[^\[\]()]*\))?"
)
"""Matches a cell with several numbers, as programs in Python write arrays and lists."""
_TUPLE: Final = re.compile(r"(?<![^,\s])[(\[]\s*[-+\d.][^()\[\],]*,[^()\[\]]*[)\]]")
"""Matches a vector with commas between its numbers, as Unity writes it."""
_STAMP: Final = re.compile(r"^\[?((?:\d{4}-\d\d-\d\d )?\d\d:\d\d:\d\d[.,]\d{3})(?: -> |\]\s*)")
"""Matches the time that monitors of a serial port, as of Arduino, put before a line."""
_DIGITS: Final = re.compile(r"\s*-?\d+(?:[eE][-+]?\d+)?\s*")
_BEGINS_WITH_NUMBER: Final = re.compile(r"\s*[-+.]?\d")
_BETWEEN_NAMES: Final = (r"\s*[,;\t]\s*", r"\s{2,}", r"\s+(?![(\[])", r"(?<=[)\]])\s+")
"""Match what stands between names that have blanks, perhaps only before a unit in brackets."""
_LABEL: Final = re.compile(
    r"[\s,;|]*(?P<name>[A-Z_][\w ./()-]{0,30}?)[ \t]*[:=][ \t]*"
    r"(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan)"
    r"(?:[ \t]*(?P<unit>[A-Zµμ°%][^\s,;|:=]{0,9})(?=[\s,;|]*(?:$|[A-Z_][\w ./()-]{0,30}[:=])))?"
    r"(?:[\s,;|]+|$)",
    re.IGNORECASE,
)
"""Matches a name with its number, as sketches for microcontrollers print them."""


def read_text(path: Path, wanted: Callable[[str], bool], options: ImportOptions) -> SourceColumns:
    """Read the wanted columns of a text file; see `read_table`.

    The separator is semicolon, tab, bar, comma or blanks, whichever gives most numbers. A comment
    sign (``#``, ``%``) before a line is removed. The encoding is that of the byte order mark, else
    UTF-16, UTF-8 or Windows-1252, as detected.

    Raises
    ------
    InputError
        The file is missing or not text, or see `read_table`.
    """
    damage = (UnicodeDecodeError, csv.Error, EOFError, zlib.error, gzip.BadGzipFile)
    with reading("text in columns", damage):
        encoding, sign = _encoding(path), options.delimiter or ";"
        with _opened(path, encoding) as stream:
            read = _without_labels(_lines(stream, []), [], sign)
            lines = list(islice(read, (options.header or 0) + _LOOKED_AT))
        if lines and lines[0].startswith('{"'):
            raise InputError("its lines are JSON: it is read if it is called .jsonl")
        delimiter = options.delimiter or _delimiter(lines[-_LOOKED_AT:], options)
        if delimiter == ",":
            _check_commas(lines)
        cut: list[str] = []
        with _opened(path, encoding) as stream:
            rows = _rows(_without_labels(_lines(stream, cut), cut, sign), delimiter)
            columns = read_table(rows, wanted, options)
        return replace(columns, notes=(*columns.notes, *cut))


def _check_commas(lines: list[str]) -> None:
    """Raise InputError if a comma stands both between cells and before decimals."""
    rows = [row for row in csv.reader(lines) if any(row)]
    begin = next((n for n, row in enumerate(rows) if all(map(_DIGITS.fullmatch, row))), 0)
    names, numbers = rows[begin - 1] if begin else [], rows[begin:]
    if names and all(len(row) > len(names) and all(map(_DIGITS.fullmatch, row)) for row in numbers):
        decimals = [cell for row in numbers for cell in row if re.match(r"0\d", cell)]
        if decimals:
            raise InputError(
                f"a row has {len(numbers[0])} cells for {len(names)} names, and one is "
                f"{decimals[0]}: commas stand between cells and before decimals, which cannot be "
                "told apart; save it with semicolons or tabs between cells"
            )


def _opened(path: Path, encoding: str) -> TextIO:
    with path.open("rb") as begin:
        packed = path.suffix.lower() == ".gz" and begin.read(2) == b"\x1f\x8b"
    opened: Any = gzip.open if packed else Path.open
    stream: TextIO = opened(path, "rt", encoding=encoding, newline="")
    return stream


def _encoding(path: Path) -> str:
    with _opened(path, "latin-1") as stream:
        begin = stream.read(4).encode("latin-1")
    if (found := json.detect_encoding(begin)) != "utf-8":
        return found
    try:
        with suppress(EOFError), _opened(path, "utf-8") as stream:  # a packed file may be cut off
            while stream.read(1 << 20):
                pass
    except UnicodeDecodeError:
        return "cp1252"  # such as a degree or mu sign from a measuring program
    return "utf-8"


def _lines(stream: TextIO, cut: list[str]) -> Iterator[str]:
    """Yield the lines, as far as they go in a file that is cut off, with a note in `cut`.

    A packed file may end early, and zero bytes end a file that was open as its machine lost power.
    """
    try:
        while line := stream.readline(_LONGEST_LINE):
            if "\0" in line:
                rest = iter(partial(stream.read, 1 << 20), "")
                if any(part.strip("\0\r\n") for part in chain([line[line.index("\0") :]], rest)):
                    raise InputError("this is not text in columns, it holds zero bytes")
                cut.append("the file ends in zero bytes: it was read to the line before them")
            elif len(line) == _LONGEST_LINE:
                raise InputError(
                    f"a line has more than {_LONGEST_LINE} characters, which no table has"
                )
            else:
                yield line
    except EOFError:
        cut.append("the packed file is cut off, and was read as far as it goes")


def _without_labels(lines: Iterator[str], notes: list[str], sign: str) -> Iterator[str]:
    """Yield lines such as ``X: 0.1  Y: 0.2 m/s^2`` as rows of numbers with their names above.

    The separator of the rows is `sign`.
    """
    start = list(islice(lines, _LOOKED_AT))
    names = Counter(tuple(n for n, _ in _labelled(line)) for line in start if line.strip())
    usual, count = names.most_common(1)[0] if names else ((), 0)
    if not usual or 2 * count <= names.total():
        yield from chain(start, lines)
        return
    notes.append("each line names its values: the names were put above as line 1, and are counted")
    yield sign.join(usual) + "\n"
    for line in chain(start, lines):
        found = _labelled(line)
        alike = tuple(name for name, _ in found) == usual
        yield sign.join(number for _, number in found) + "\n" if alike else line


def _labelled(line: str) -> list[tuple[str, str]]:
    """Return the names and numbers of a line that has nothing else; units go to the names."""
    found, end = [], 0
    while end < len(line):
        match = _LABEL.match(line, end)
        if match is None:
            return []
        found.append(match)
        end = match.end()
    cells, unit = [], ""
    for match in reversed(found):  # a unit is also that of the values before it, if they have none
        name = match["name"]
        unit = match["unit"] or ("" if target_of(name) == "time" else unit)
        cells.append((f"{name} [{unit}]" if unit else name, match["number"]))
    return cells[::-1]


def _rows(lines: Iterator[str], delimiter: str) -> Iterator[Sequence[str]]:
    plain = (_separated(line, delimiter) for line in _uncommented(_of_one_heading(lines)))
    if delimiter == " ":
        return _unpacked(_by_blanks(plain))
    return _unpacked(csv.reader(plain, delimiter=delimiter, skipinitialspace=True))


def _separated(line: str, delimiter: str) -> str:
    """Return a line whose stamp and vectors are cells of their own; most lines have neither."""
    if " -> " in line or line[:1] == "[":
        line = _STAMP.sub(lambda found: found[1] + delimiter, line)
    if delimiter == "," and ("(" in line or "[" in line) and '"' not in line:
        line = _TUPLE.sub(r'"\g<0>"', line)
    return line


def _unpacked(rows: Iterator[list[str]]) -> Iterator[Sequence[str]]:
    """Return rows in which a cell such as ``[1 2 3]`` is three, and so is the name above it."""

    def numbers_in(cell: str) -> list[str]:
        found = _VECTOR.fullmatch(cell.strip())
        return re.split(r"[,;\s]+", found[1].strip()) if found else []

    def unpacked(row: list[str]) -> list[str]:
        if len(row) != len(counts):
            return row
        cells = []
        for cell, count in zip(row, counts, strict=True):
            named = [f"{cell}[{place}]" for place in range(count)] if count > 1 else [cell]
            cells += numbers_in(cell) or named
        return cells

    start = list(islice(rows, _LOOKED_AT))
    each = ([len(numbers_in(cell)) for cell in row] for row in start)
    counts = next((counts for counts in each if max(counts, default=0) > 1), [])
    return map(unpacked, chain(start, rows)) if counts else chain(start, rows)


def _of_one_heading(lines: Iterator[str]) -> Iterator[str]:
    """Yield the lines; of the headings of a LabVIEW file's segments only the units."""
    labview, in_heading, units = False, False, "Y_Unit_Label"
    for line in lines:
        ends = line.startswith("***End_of_Header***")
        labview = labview or ends
        in_heading = in_heading or (labview and line.startswith("Channels"))
        of_units = in_heading and line.startswith(units)
        yield "\n" if in_heading and not of_units else line
        units = "***" if of_units else units
        in_heading = in_heading and not ends


def _uncommented(lines: Iterator[str]) -> Iterator[str]:
    """Yield lines without their comment signs; of comments among numbers only the sign."""
    numbers = 0
    for line in lines:
        if line[:1] in ("#", "%"):
            yield line[0] if numbers > 1 else line.lstrip("#%").lstrip(" ")
            continue
        inside = line.strip("[]() \t\r\n,;") if line.lstrip()[:1] in ("[", "(") else ""
        is_list = inside and not any(sign in inside for sign in "[]()")  # as Python prints it
        text = f"{inside}\n" if is_list else line
        begin = text.lstrip(' \t"+-.')[:1]
        numbers += begin.isdigit()
        yield text


def _by_blanks(lines: Iterator[str]) -> Iterator[list[str]]:
    """Yield the cells of lines; names may have blanks, where another sign between them is clear."""
    start = list(islice(lines, _LOOKED_AT))
    widths = Counter(len(line.split()) for line in start if _BEGINS_WITH_NUMBER.match(line))
    usual = max(widths, key=lambda width: (widths[width], width), default=0)
    for line in chain(start, lines):
        cells = line.split()
        if '"' in line:
            cells = next(csv.reader([line.strip()], delimiter=" ", skipinitialspace=True))
        elif len(cells) > usual > 1 and not _BEGINS_WITH_NUMBER.match(line):
            each = (re.split(sign, line.strip()) for sign in _BETWEEN_NAMES)
            cells = next((names for names in each if len(names) == usual), cells)
        yield cells


def _delimiter(lines: list[str], options: ImportOptions) -> str:
    """Return the separator that gives most numbers, then occurs most, then is first in `_SIGNS`."""

    def worth(sign: str) -> tuple[float, int]:
        try:
            numbers = weigh_numbers(_rows(iter(lines), sign), options)
        except csv.Error:  # a wide table's line, taken for one cell, is too long
            numbers = 0
        each = round(numbers / max(1, len(lines)), 1)  # a date in the notes must not decide
        return max(0, each), sum(sign in line for line in lines)

    return max(_SIGNS, key=worth)
