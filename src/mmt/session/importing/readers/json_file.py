"""Read JSON: a line or an element for each row, or an object of arrays or with one list of rows.

A row is an object or a list. The forms in which pandas writes a table are read, too.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt.session.importing.column_names import gives_unit, last_part, names_of, unit_name
from mmt.session.importing.columns import SourceColumns, distinct, reading
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import columns_of

_LONGEST_CELL: Final = 16
"""Numbers in a cell of a row at most; longer lists are columns."""


def read_json(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> SourceColumns:
    """Read the wanted columns (n,), or (n, k) for lists, of JSON lines or of one JSON value.

    Members of objects are called ``a.b``. Members that a row lacks, and null, are missing values.
    Rows that are lists have the columns "1", "2" and on, or the names in the first of them. Of
    JSON lines a last one that is cut off is left out.

    Raises
    ------
    InputError
        The file is missing or not JSON, a row is of another kind than the first, or a wanted
        column does not hold numbers or lists of one length.
    """
    notes = list[str]()
    with reading("JSON", (ValueError, RecursionError)), ExitStack() as stack:
        with path.open("rb") as begin:
            encoding = json.detect_encoding(begin.read(4))
        file = stack.enter_context(path.open(encoding=encoding))
        content = _whole(file.read()) if path.suffix.lower() == ".json" else None
        if content is None:
            file.seek(0)
            content = list(_lines(file, notes))
        if isinstance(content, dict):
            content = _of_pandas(content) or _rows_in(content)
        if isinstance(content, list) and content and isinstance(content[0], list):
            content = _named(content)
        if isinstance(content, dict):
            leaves = dict(_leaves(content))
            columns = {n: x for n, x in leaves.items() if isinstance(x, list) or gives_unit(n)}
            names = list(columns)
        elif isinstance(content, list):
            names, columns = _columns(content, wanted)
        else:
            raise InputError("it holds neither rows nor arrays")
        arrays = {name: _array(column, name) for name, column in columns.items() if wanted(name)}
    return SourceColumns(names=names, notes=notes, **columns_of(arrays))


def _of_pandas(content: dict[str, Any]) -> Any:
    """Return the rows, or lists by column, of what pandas calls split, index or columns."""
    names, data, labels = (content.get(key) for key in ("columns", "data", "index"))
    if isinstance(names, list) and isinstance(data, list):
        return _named(data, list(map(str, names))) | _index(labels or [])
    keys = {tuple(row) if isinstance(row, dict) else () for row in content.values()}
    first = keys.pop() if len(keys) == 1 else ()
    cells = [cell for row in content.values() for cell in row.values()] if first else []
    lists = [len(cell) for cell in cells if isinstance(cell, list)]
    if not first or any(isinstance(cell, dict) for cell in cells):
        return None
    if len(content) > len(first) and max(lists, default=0) <= _LONGEST_CELL:
        columns = {name: [row[name] for row in content.values()] for name in first}
        return columns | _index(list(content))
    columns = {name: list(column.values()) for name, column in content.items()}
    return None if lists else columns | _index(first)


def _index(labels: Sequence[Any]) -> dict[str, list[Any]]:
    """Return the rows' labels as a column, if they are more than the rows' numbers."""
    counted = list(map(str, labels)) == [str(number) for number in range(len(labels))]
    return {} if counted else {"index": list(labels)}


def _named(rows: Sequence[Any], names: Sequence[str] = ()) -> dict[str, list[Any]]:
    """Return the columns of rows that are lists; without names the first may hold these."""
    width = len(names or rows[0])
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, list) or len(row) != width:
            alike = "there are names" if names else "the first has"
            raise InputError(f"row {number} is not a list of as many values as {alike}")
    if not names and all(isinstance(cell, str) and cell.strip() for cell in rows[0]):
        names, rows = rows[0], rows[1:]
    called, _ = distinct(names or [str(place) for place in range(1, width + 1)])
    return dict(zip(called, map(list, zip(*rows, strict=True)), strict=False))


def _rows_in(content: dict[str, Any]) -> Any:
    """Return the one list of rows in an object, if it is longer than any array; else the object.

    The first row gets the units that are beside the rows.
    """
    tables = [member for member in content.values() if _is_table(member)]
    beside = {name: member for name, member in content.items() if not _is_table(member)}
    longest = max((len(each) for _, each in _leaves(beside) if isinstance(each, list)), default=0)
    if len(tables) != 1 or len(tables[0]) <= longest:
        return content
    told = {n: text for n, text in _leaves(beside) if gives_unit(n) and isinstance(text, str)}
    units = {last_part(unit_name(name)): text for name, text in told.items()}
    first, *rows = tables[0]
    return [units | first if isinstance(first, dict) else first, *rows]


def _is_table(member: Any) -> bool:
    return isinstance(member, list) and any(isinstance(row, dict) for row in member)


def _whole(text: str) -> Any:
    """Return the value of a text; None if its lines are values of their own."""
    try:
        return _parsed(text)
    except ValueError:
        first, *others = text.lstrip().split("\n", 2)
        with suppress(ValueError):
            if others and isinstance(_parsed(first), dict | list):
                return None
        raise


def _parsed(text: str) -> Any:
    return json.loads(text, object_pairs_hook=_members)


def _members(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object's members; of two with one name both, with numbers."""
    members = dict(pairs)
    if len(members) == len(pairs):
        return members
    names, _ = distinct([name for name, _ in pairs])
    return dict(zip(names, (value for _, value in pairs), strict=True))


def _lines(lines: Iterable[str], notes: list[str]) -> Iterator[Any]:
    """Yield the value of each line."""
    cut = ""
    for number, line in enumerate(lines, start=1):
        if cut:
            raise InputError(cut)
        if line.strip():
            try:
                yield _parsed(line)
            except ValueError as error:
                cut = f"line {number} is not JSON: {error}"
    if cut:
        notes.append(f"the last line is cut off, and was left out ({cut})")


def _columns(
    rows: Sequence[Any], wanted: Callable[[str], bool]
) -> tuple[list[str], dict[str, list[Any]]]:
    """Return the names of all columns of rows, and the wanted columns."""
    names: dict[str, None] = {}
    columns: dict[str, list[Any]] = {}
    for place, row in enumerate(rows):
        if not isinstance(row, dict):
            raise InputError(f"row {place + 1} is not an object with a member for each column")
        for name, value in _leaves(row):
            names[name] = None
            if wanted(name):
                column = columns.setdefault(name, [])
                column += [None] * (place - len(column))
                column.append(value)
    padded = {name: [*some, *[None] * (len(rows) - len(some))] for name, some in columns.items()}
    return list(names), padded


def _leaves(value: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield name and value of each member that is no object; lists with objects are taken apart."""
    for name, member in value.items():
        if isinstance(member, list) and any(isinstance(each, dict) for each in member):
            objects = [each if isinstance(each, dict) else {} for each in member]
            yield from _leaves(
                dict(zip(names_of(objects), member, strict=True)), f"{prefix}{name}."
            )
        elif isinstance(member, dict):
            yield from _leaves(member, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", member


def _array(column: Sequence[Any], name: str) -> Any:
    """Return a column (n,) or (n, k) of cells."""
    column = column if isinstance(column, list) else [column]
    widths = {len(value) for value in column if isinstance(value, list)}
    if not widths:
        return np.array(column, dtype=object)
    if len(widths) > 1 or not all(value is None or isinstance(value, list) for value in column):
        raise InputError(f"the lists of {name} are not all of one length")
    missing = [None] * widths.pop()
    return np.array([missing if value is None else value for value in column], dtype=object)
