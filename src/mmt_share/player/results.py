"""CSV file with the results of the scenarios; each row is on the disk before the next comes."""

import csv
import io
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from mmt.core.errors import InputError, MmtError
from mmt.core.files.existing import append_lines

COLUMNS: Final = (
    "time_utc",
    "participant",
    "scenario",
    "begun_utc",
    "seed",
    "event",
    "trial",
    "sample",
    "tile",
    "texture",
    "correct",
    "rating",
    "stroked_s",
    "elapsed_s",
)

Value = str | int | float | None


def now_utc() -> str:
    """Return the present time, to the millisecond."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


class ResultsFile:
    """Append rows to a results file.

    Parameters
    ----------
    path
        Created, with its folders, at the first row.

    Raises
    ------
    InputError
        The file exists and has other columns.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.rows = 0
        """Rows written by this object."""
        self._check()

    def write(self, row: Mapping[str, Value]) -> None:
        """Write a row and wait until it is on the disk.

        Raises
        ------
        MmtError
            It cannot be written.
        """
        try:
            line = _line([row.get(name) for name in COLUMNS])
            append_lines(self.path, line, header=_line(COLUMNS))
        except OSError as error:
            raise MmtError(f"results {self.path}: {error.strerror or error}") from error
        self.rows += 1

    def _check(self) -> None:
        try:
            with self.path.open(encoding="utf-8", newline="") as stream:
                header = next(csv.reader(stream), None)
        except FileNotFoundError:
            return
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            reason = error.strerror if isinstance(error, OSError) else None
            raise InputError(f"results {self.path}: {reason or error}") from error
        if header is not None and tuple(header) != COLUMNS:
            raise InputError(
                f"results {self.path}: its columns are not those of results; name another file"
            )


def _line(values: object) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(values)  # type: ignore[arg-type]  # a sequence
    return text.getvalue()
