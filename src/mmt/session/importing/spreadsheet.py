"""Excel workbooks: the sheet that was open when the file was saved."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.session.importing.columns import Columns
from mmt.session.importing.table import read_table


def read_spreadsheet(path: Path, wanted: Callable[[str], bool]) -> Columns:
    """Read the wanted columns of a workbook's active sheet, see `read_table`.

    Raises
    ------
    InputError
        openpyxl is not installed, the file is missing or no workbook, or see `read_table`.
    """
    origin = f"import {path}"
    require("openpyxl")
    import openpyxl
    from openpyxl.utils.exceptions import InvalidFileException

    try:
        book: Any = openpyxl.load_workbook(path, read_only=True, data_only=True)
        try:
            return read_table(origin, book.active.iter_rows(values_only=True), wanted)
        finally:
            book.close()
    except OSError as error:
        raise InputError(f"{origin}: {error.strerror or error}") from error
    except (
        *(InvalidFileException, zipfile.BadZipFile, KeyError, ValueError, AttributeError),
        *(NotImplementedError, RuntimeError, SyntaxError),  # SyntaxError: XML that is cut off
    ) as error:
        raise InputError(
            f"{origin}: this is not an .xlsx workbook with a table: {error}"
        ) from error
