"""Excel workbooks: the sheet that was open when the file was saved."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mmt.core.errors import InputError, brief
from mmt.core.extras import require
from mmt.session.importing.columns import Columns
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.table import read_table


def read_spreadsheet(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> Columns:
    """Read the wanted columns of a workbook's active sheet, see `read_table`.

    Raises
    ------
    InputError
        openpyxl is not installed, the file is missing or no workbook, or see `read_table`.
    """
    origin = f"import {path}"
    require("openpyxl")
    import openpyxl

    try:
        book: Any = openpyxl.load_workbook(path, read_only=True, data_only=True)
        try:
            return read_table(origin, book.active.iter_rows(values_only=True), wanted)
        finally:
            book.close()
    except OSError as error:
        raise InputError(f"{origin}: {error.strerror or error}") from error
    except InputError:
        raise
    except Exception as error:  # damage reaches every part of the library
        raise InputError(
            f"{origin}: this is not an .xlsx workbook with a table: {brief(error)}"
        ) from error
