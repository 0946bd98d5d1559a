"""Parse the cells of tables: numbers, dates, times of day, and marks of missing values."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, date, datetime, time, timedelta
from decimal import Decimal
from typing import Any, Final, TypeAlias

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.units import DATE, is_unit
from mmt.session.importing.options import ImportOptions

Cell: TypeAlias = str | float | Decimal | date | time | timedelta | None

_NO_VALUE: Final = (
    " na n/a #n/a #na <na> #nv nan nat null none nil undefined - -- --- ? ∞ -∞ "
    "#div/0! #value! #ref! #num! #name? #null!"
)
MISSING: Final = frozenset(_NO_VALUE.split(" "))
_NO_NUMBER: Final = re.compile(r"[-+]?(1\.#\w+|nan\(\w+\))")
"""Matches what C libraries print for NaN, in lower case."""
_DATES: Final = (
    *(f"%d.%m.%Y %H:%M:%S{part}" for part in (".%f", "")),
    *(f"%Y/%m/%d %H:%M:%S{part}" for part in (".%f", "")),
    *(f"%d-%b-%Y %H:%M:%S{part}" for part in (".%f", "")),  # as MATLAB writes them
    *(f"%m/%d/%Y %I:%M:%S{part} %p" for part in (".%f", "")),  # of the United States
)
_TIMES: Final = ("%H:%M:%S.%f", "%H:%M:%S", "%M:%S.%f", "%I:%M:%S.%f %p", "%I:%M:%S %p")
_MOMENT: Final = re.compile(r"(\S+ )?\d\d?:\d\d?(:\d\d?)?(\.\d+)?( [ap]m)?", re.IGNORECASE)
"""Matches a text that may have one of these forms, with a date or without: to try them is slow."""
_DURATION: Final = re.compile(r"(\d+) days?[.,]? \+?(.+)")
_GROUPED: Final = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
"""Matches a number that may have a comma before its thousands."""
_BOTH_SIGNS: Final = re.compile(r"[-+]?\d{1,3}([.,])\d{3}(?:\1\d{3})*(?!\1)([.,])\d*")
"""Matches a number with one sign before its thousands and the other before its decimals."""
_OF_THOUSANDS: Final = re.compile(r"[-+]?[1-9]\d{0,2}([.,])\d{3}(?:\1\d{3})+")
"""Matches a number with several of the same sign, which stand before its thousands."""
_SPACED: Final = re.compile(r"(?<=\d)['’\u2009\u202f\xa0](?=\d{3}(?!\d))")  # noqa: RUF001
"""Matches an apostrophe or blank before thousands."""
_FORTRAN: Final = re.compile(r"^([-+]?[\d.,]+)[dD]([-+]?\d+)$")
_HEX: Final = re.compile(r"0[xX]([0-9a-fA-F]+)")
_WITH_UNIT: Final = re.compile(r"([-+]?[.,]?\d[\d.,]*(?:[eE][-+]?\d+)?)\s*(\D.*)")
_REPR: Final = re.compile(r"^(?:(?:np|numpy)\.\w+|tensor)\(([^()]*)\)$")
"""Matches a number as NumPy and PyTorch print it within lists."""
_MOST_COMPONENTS: Final = 16
"""Arrays with at most so many rows, and more columns, have their samples along the columns."""


def text_of(cell: Cell | bytes) -> str:
    """Return a cell's text without surrounding blanks."""
    return "" if cell is None else str(_decoded(cell)).strip()


def _decoded(cell: Any) -> Any:
    return cell.decode(errors="replace") if isinstance(cell, bytes) else cell


def weigh_numbers(rows: Iterable[Sequence[Cell]], options: ImportOptions) -> int:
    """Return the count of numeric cells minus that of texts, over rows that have a number."""
    number, weight = Numbers(options), 0
    for row in rows:
        numbers = sum(map(number.reads, row))
        weight += numbers - sum(not number.takes(cell) for cell in row) if numbers else 0
    return weight


class Numbers:
    """Parser of cells: returns a number, or None for a missing value; ValueError for other text.

    Hexadecimal numbers, as two's complement of the width written, and numbers with a unit are read
    unless only `plain` ones are.
    """

    def __init__(self, options: ImportOptions, *, plain: bool = False) -> None:
        self._forms: dict[str, Counter[str]] = {}
        self._reads_forms = not plain
        self._commas = self._grouped = self._points = ""
        self._missing = MISSING | {text.strip().lower() for text in options.missing}
        self._thousands = {".": ",", ",": "."}.get(options.decimal or "")
        self._plain = not (options.missing or options.decimal)

    def __call__(self, cell: Cell, column: str = "") -> float | None:
        """Return the number in a cell, or None for a missing value; see `unit_in` for `column`."""
        if cell is None or cell == "":
            return None
        if isinstance(cell, str) and "_" in cell:  # which Python would leave out
            raise ValueError(cell)
        if self._plain and isinstance(cell, str | float | int):
            try:
                value = float(cell)
            except ValueError:
                pass
            else:
                if not self._points and isinstance(cell, str) and "." in cell:
                    self._points = cell
                return value
        text = text_of(cell)
        if text.lower() in self._missing or _NO_NUMBER.fullmatch(text.lower()):
            return None
        found = float(cell) if isinstance(cell, float | int | Decimal) else seconds_of(cell)
        if found is not None:
            return found
        text = _FORTRAN.sub(r"\1e\2", _SPACED.sub("", _REPR.sub(r"\1", text.replace("−", "-"))))  # noqa: RUF001
        try:
            return self._of_signs(text)
        except ValueError:
            value, form = self._of_form(text)
        self._forms.setdefault(column, Counter())[form] += 1
        return value

    def _of_form(self, text: str) -> tuple[float, str]:
        """Return the number in a text that is hexadecimal or has a unit, and its digits or unit."""
        if self._reads_forms and (found := _HEX.fullmatch(text)):
            bits, value = 4 * len(found[1]), int(found[1], 16)
            return float(value - (value >> (bits - 1) << bits)), f"0x and {len(found[1])} digits"
        if self._reads_forms and (found := _WITH_UNIT.fullmatch(text)) and is_unit(found[2]):
            return self._of_signs(found[1]), found[2]
        raise ValueError(text)

    def unit_in(self, column: str, values: FloatArray) -> str:
        """Return the unit that all cells of a column had whose numbers are `values` (n,), or "".

        Raises
        ------
        InputError
            Cells have different units or widths of hexadecimal numbers, or some have none.
        """
        forms = self._forms.get(column, Counter[str]())
        if len(forms) > 1 or 0 < forms.total() < np.isfinite(values).sum():
            others = "" if len(forms) > 1 else " or with nothing"
            raise InputError(
                f"the numbers of {column} are written with {' or with '.join(forms)}"
                f"{others}: write all alike"
            )
        return next((form for form in forms if not form.startswith("0x")), "")

    def _of_signs(self, text: str) -> float:
        """Return the number in a text by the signs in it, and note which sign is which."""
        if self._thousands:
            return float(text.replace(self._thousands, "").replace(",", "."))
        decimal, plain = "," if "," in text else ".", text.replace(",", ".")
        if grouped := _BOTH_SIGNS.fullmatch(text):
            thousands, decimal = grouped.groups()
            plain = text.replace(thousands, "").replace(decimal, ".")
        elif several := _OF_THOUSANDS.fullmatch(text):
            decimal = ".,"[several[1] == "."]
            plain = text.replace(several[1], "")
        value = float(plain)
        if decimal == ".":
            self._points = self._points or (text if decimal in text or "," in text else "")
        elif _GROUPED.fullmatch(text):
            self._grouped = self._grouped or text
        else:
            self._commas = self._commas or text
        return value

    def check(self, name: str = "") -> None:
        """Check that the decimal sign of the cells so far is certain.

        Raises
        ------
        InputError
            A comma may stand before decimals or before thousands.
        """
        comma = self._commas or self._grouped
        if comma and (self._points or not self._commas):
            sign = "a comma" if "," in comma else "points before thousands"
            raise InputError(
                f"{name}there are numbers with {sign} ({comma}) and "
                f"{'with a point' if self._points else 'no other decimals'}: say which is the "
                "decimal sign (--decimal . or --decimal ,)"
            )

    def reads(self, cell: Cell) -> bool:
        """Return whether a cell holds a number."""
        try:
            value = self(cell)
        except ValueError:
            return False
        return value is not None and not math.isnan(value)

    def places(self, row: Sequence[Cell]) -> set[int]:
        """Return the places of the cells of a row that hold a number."""
        return {place for place, cell in enumerate(row) if self.reads(cell)}

    def takes(self, cell: Cell) -> bool:
        """Return whether a cell holds a number or a missing value."""
        try:
            self(cell)
        except ValueError:
            return False
        return True


def numbers_in(values: Any, name: str) -> tuple[FloatArray, str]:
    """Return an array's numbers, and the unit of its texts: `DATE` of dates or times, else "".

    Texts are parsed as the cells of tables. Vectors become (n,), and arrays with samples along the
    columns are transposed to (n, k).

    Raises
    ------
    InputError
        The array `name` holds something else.
    """
    array, unit = np.asarray(values), ""
    if array.dtype.kind in "mM":
        since = array - np.datetime64(0, "s") if array.dtype.kind == "M" else array
        array, unit = since / np.timedelta64(1, "s"), DATE
    elif array.dtype.kind in "SUO":
        number = Numbers(ImportOptions())
        cells = list(map(_decoded, array.ravel().tolist()))
        try:
            found = [number(cell, name) for cell in cells]
        except (ValueError, TypeError) as error:
            raise InputError(f"{name} does not hold numbers: {error}") from error
        number.check(f"{name}: ")
        unit = DATE if cells and seconds_of(cells[0]) is not None else ""
        array = np.array(found, dtype=np.float64).reshape(array.shape)
        unit = number.unit_in(name, array) or unit
    elif array.dtype.kind == "c" and not array.imag.any():
        array = array.real
    elif array.dtype.kind not in "iufb":
        raise InputError(f"{name} holds {array.dtype}, not numbers")
    numbers: FloatArray = array.astype(np.float64)
    if numbers.ndim == 2:
        if numbers.shape[0] <= _MOST_COMPONENTS < numbers.shape[1]:
            numbers = numbers.T
        if numbers.shape[1] == 1:
            numbers = numbers[:, 0]
    return numbers, unit


def columns_of(arrays: Mapping[str, Any], told: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return arrays as the fields ``values``, ``units`` and ``labels`` of `SourceColumns`.

    Units that a file has `told` count unless the values are dates; see `numbers_in`. Labels are
    the texts (n,) of columns without any number.
    """
    values, labels = {}, {}
    units = {name: unit for name, unit in (told or {}).items() if unit}
    for name, array in arrays.items():
        try:
            values[name], unit = numbers_in(array, name)
        except InputError:
            cells = np.ravel(array).tolist()
            number = Numbers(ImportOptions()).reads
            texts = np.ndim(array) < 2 and all(isinstance(c, str | bytes | None) for c in cells)
            if not texts or any(map(number, cells)):
                raise
            labels[name] = np.array(list(map(text_of, cells)))
        else:
            units |= {name: unit} if unit else {}
    return {"values": values, "labels": labels, "units": units}


def seconds_of(cell: Cell) -> float | None:
    """Return a date in seconds since 1970, a time of day in seconds since midnight, else None."""
    if isinstance(cell, str):
        cell = _moment(cell.strip().replace(",", "."))
    if isinstance(cell, timedelta):
        return cell.total_seconds()
    if isinstance(cell, time):
        return (datetime.combine(date.min, cell, None) - datetime.min).total_seconds()
    if isinstance(cell, datetime):
        return (cell if cell.tzinfo else cell.replace(tzinfo=UTC)).timestamp()
    return None


def _moment(text: str) -> datetime | time | timedelta | None:
    if ":" not in text or not text[0].isdigit():
        return None
    if duration := _DURATION.fullmatch(text):
        seconds_s = seconds_of(duration[2])
        return None if seconds_s is None else timedelta(int(duration[1]), seconds_s)
    with_minutes = text.count(":") == 1 and "." in text  # not 10:30.5 for half a second past 10:30
    for read in () if with_minutes else (datetime.fromisoformat, time.fromisoformat):
        try:
            return read(text)
        except ValueError:
            continue
    if formed := _MOMENT.fullmatch(text):
        for form in _DATES if formed[1] else _TIMES:
            with suppress(ValueError):
                found = datetime.strptime(text, form).replace(tzinfo=UTC)
                return found if formed[1] else found.time()
    return None
