"""Parse the cells of tables: numbers, dates, times of day, and marks of missing values."""

from collections.abc import Iterable, Sequence
from datetime import UTC, date, datetime, time, timedelta
from typing import Final, TypeAlias

from mmt.session.importing.options import ImportOptions

Cell: TypeAlias = str | float | date | time | timedelta | None

MISSING: Final = frozenset(
    ("", "na", "n/a", "#n/a", "#na", "#nv", "nan", "null", "none", "nil", "-", "--", "---", "?")
) | {"#div/0!", "#value!", "#ref!", "#num!", "#name?", "#null!"}
_DATES: Final = ("%d.%m.%Y %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S", "%M:%S.%f")


def text_of(cell: Cell) -> str:
    """Return a cell's text without surrounding blanks."""
    return "" if cell is None else str(cell).strip()


def weigh_numbers(rows: Iterable[Sequence[Cell]], options: ImportOptions) -> int:
    """Return the count of numeric cells minus that of others, over rows that have a number."""
    number, weight = Numbers(options), 0
    for row in rows:
        filled = [cell for cell in row if text_of(cell)]
        numbers = sum(map(number.reads, filled))
        weight += 2 * numbers - len(filled) if numbers else 0
    return weight


class Numbers:
    """Parser of cells: returns a number, or None for a missing value; ValueError for other text."""

    def __init__(self, options: ImportOptions) -> None:
        self.commas = ""
        """A cell whose comma was taken for the decimal sign, or "" if there was none."""
        self._missing = MISSING | {text.strip().lower() for text in options.missing}
        self._thousands = {".": ",", ",": "."}.get(options.decimal or "")
        self._plain = not (options.missing or options.decimal)

    def __call__(self, cell: Cell) -> float | None:
        """Return the number in a cell, or None for a missing value."""
        if self._plain and isinstance(cell, str | float | int):
            try:
                return float(cell)
            except ValueError:
                pass
        text = text_of(cell)
        if text.lower() in self._missing:
            return None
        found = float(cell) if isinstance(cell, float | int) else seconds_of(cell)
        if found is not None:
            return found
        if self._thousands:
            return float(text.replace(self._thousands, "").replace(",", "."))
        if "," not in text or "." in text:
            return float(text)
        value = float(text.replace(",", ".", 1))
        self.commas = self.commas or text
        return value

    def reads(self, cell: Cell) -> bool:
        """Return whether a cell holds a number."""
        return self.takes(cell) and text_of(cell).lower() not in self._missing

    def takes(self, cell: Cell) -> bool:
        """Return whether a cell holds a number or a missing value."""
        try:
            self(cell)
        except ValueError:
            return False
        return True

    def has_point(self, cell: Cell) -> bool:
        """Return whether a cell holds a number with a decimal point."""
        return (
            isinstance(cell, str)
            and "." in cell
            and self._plain
            and self.reads(cell)
            and seconds_of(cell) is None
        )


def seconds_of(cell: Cell) -> float | None:
    """Return a date in seconds since 1970, a time of day in seconds since midnight, else None."""
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
