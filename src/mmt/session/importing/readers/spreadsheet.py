"""Read a sheet of an Excel workbook; by default the one that was active when it was saved."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.session.importing.columns import SourceColumns, reading
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import Cell
from mmt.session.importing.readers.table import read_table


def read_spreadsheet(
    path: Path, wanted: Callable[[str], bool], options: ImportOptions
) -> SourceColumns:
    """Read the wanted columns of a workbook's sheet; see `read_table`.

    Raises
    ------
    InputError
        openpyxl is not installed, the file is missing or not a workbook, or see `read_table`.
    """
    require("openpyxl")
    import openpyxl

    with reading("an .xlsx workbook with a table"), path.open("rb") as file:
        book: Any = openpyxl.load_workbook(file, read_only=True, data_only=True)
        try:
            sheet = _sheet(book, options.sheet)
            sheet.reset_dimensions()  # some programs state too small ones
            rows = _padded(sheet.iter_rows(values_only=True))
            columns = read_table(rows, wanted, options)
        finally:
            book.close()
        if options.sheet is not None or len(book.sheetnames) == 1:
            return columns
        others = ", ".join(name for name in book.sheetnames if name != sheet.title)
        note = f"this is the sheet {sheet.title}; --sheet takes another: {others}"
        return replace(columns, notes=(note, *columns.notes))


def _padded(rows: Iterable[Sequence[Cell]]) -> Iterator[Sequence[Cell]]:
    """Yield rows with blanks to the width of the widest before; they end with their last cell."""
    width = 0
    for row in rows:
        width = max(width, len(row))
        yield [*row, *[None] * (width - len(row))]


def _sheet(book: Any, name: str | None) -> Any:
    if name is None:
        return book.active if book.active in book.worksheets else book.worksheets[0]
    if name not in book.sheetnames and name.isdecimal():
        name = dict(enumerate(book.sheetnames, start=1)).get(int(name), name)
    if name not in book.sheetnames:
        raise InputError(f"--sheet {name}: there are {', '.join(book.sheetnames)}")
    return book[name]
