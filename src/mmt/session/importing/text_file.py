"""Tables in text: comma, semicolon or tab between the cells, decimal point or comma."""

import csv
import re
from collections.abc import Callable
from itertools import islice
from pathlib import Path

from mmt.core.errors import InputError, brief
from mmt.session.importing.columns import Columns
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.table import read_table

_LOOKED_AT = 50
_DECIMAL_COMMA = re.compile(r"^\s*[-+]?\d*,\d+(?:[eE][-+]?\d+)?\s*$")


def read_text(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> Columns:
    """Read the wanted columns of a text file, see `read_table`.

    The separator is that of semicolon, tab and comma which stands in most of the first lines;
    with the first two, a comma within a cell is the decimal sign. The encoding is UTF-8, else
    Windows-1252.

    Raises
    ------
    InputError
        The file is missing, no text, or see `read_table`.
    """
    origin = f"import {path}"
    try:
        encoding = _encoding(path)
        with path.open(encoding=encoding, newline="") as stream:
            lines = list(islice(stream, _LOOKED_AT))
        if any("\0" in line for line in lines):
            raise InputError(f"{origin}: this is not text in columns, it holds zero bytes")
        delimiter = _delimiter(lines)
        cells = (cell for row in csv.reader(lines, delimiter=delimiter) for cell in row)
        decimal_comma = delimiter != "," and any(map(_DECIMAL_COMMA.match, cells))
        with path.open(encoding=encoding, newline="") as stream:
            rows = csv.reader(stream, delimiter=delimiter)
            return read_table(origin, rows, wanted, decimal_comma=decimal_comma)
    except OSError as error:
        raise InputError(f"{origin}: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{origin}: this is not text in columns: {brief(error)}") from error


def _encoding(path: Path) -> str:
    try:
        with path.open(encoding="utf-8-sig") as stream:
            while stream.read(1 << 20):
                pass
    except UnicodeDecodeError:
        return "cp1252"  # a degree or mu sign of a measuring program
    return "utf-8-sig"


def _delimiter(lines: list[str]) -> str:
    """Return the separator that stands in most lines; where it stands in as many, in this order."""
    return max(";\t,", key=lambda sign: sum(sign in line for line in lines))
