"""Sessions as CSV, with a column for each axis of each channel."""

import csv
from array import array
from collections.abc import Iterable
from pathlib import Path
from typing import TextIO

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.frames import FIELD_OF_CHANNEL, Channel
from mmt.session.data import RecordedSession, axis_columns
from mmt.session.files import replacing
from mmt.session.resampling import to_frames
from mmt.session.samples import Samples

_FIRST_ROW = 2
"""The line of the first row, as editors count: line 1 is the header."""

_SHOWN_COLUMNS = 12
_SHOWN_CHARACTERS = 60


def read_csv(path: Path, longest_gap_s: float | None = None) -> RecordedSession:
    """Read a recording; see `mmt.session.import_session`.

    The first line names the columns, separated by commas; columns of other names are
    ignored. A column may end before the others (empty cells): so acceleration of another
    rate can be beside position and force.

    Raises
    ------
    InputError
        The file is missing or empty, a column is missing, or a cell does not hold a number.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            columns = _columns(path, stream)
    except OSError as error:
        raise InputError(f"import {path}: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"import {path}: this is not text in columns: {error}") from error
    samples = Samples(
        origin=f"import {path}",
        time_s=columns["time_s"],
        values={c: v for c in FIELD_OF_CHANNEL if (v := _vectors(path, columns, c)) is not None},
        acceleration_time_s=columns.get("acceleration_time_s"),
        sequence=columns.get("sequence"),
        row_name=lambda row: f"line {row + _FIRST_ROW}",
    )
    return RecordedSession(frames=to_frames(samples, longest_gap_s), path=path)


def write_csv(path: Path, session: RecordedSession) -> None:
    """Write the frames; single precision needs nine digits.

    Raises
    ------
    InputError, MmtError
        See `mmt.session.export_session`.
    """
    columns = session.columns()
    formats = [
        "%d" if values.dtype.kind in "iu" else "%.9f" if name == "time_s" else "%.9g"
        for name, values in columns.items()
    ]
    table = np.column_stack([values.astype(np.float64) for values in columns.values()])
    with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as stream:
        np.savetxt(stream, table, fmt=formats, delimiter=",", header=",".join(columns), comments="")


def _columns(path: Path, stream: TextIO) -> dict[str, FloatArray]:
    rows = csv.reader(stream)
    header = [name.strip() for name in next(rows, [])]
    if not header:
        raise InputError(f"import {path}: the file is empty")
    if "time_s" not in header:
        raise InputError(f"import {path}: no column time_s; {_shown(header)}")
    known = {"sequence", "time_s", "acceleration_time_s"}
    known |= {name for channel in FIELD_OF_CHANNEL for name in axis_columns(channel)}
    wanted = {name: header.index(name) for name in header if name in known}
    numbers = {name: array("d") for name in wanted}
    for line, row in enumerate(rows, start=_FIRST_ROW):
        cells = ((name, column, numbers[name]) for name, column in wanted.items())
        _append_row(path, line, row, cells)
    return {name: np.array(values) for name, values in numbers.items()}


def _shown(header: list[str]) -> str:
    """Name the columns in a text that stays short however many there are, and however long."""
    names = [name[:_SHOWN_CHARACTERS] for name in header[:_SHOWN_COLUMNS]]
    if len(names) == len(header):
        return f"the columns are {', '.join(names)}"
    return f"the first of {len(header)} columns are {', '.join(names)}"


def _append_row(
    path: Path, line: int, row: list[str], columns: Iterable[tuple[str, int, "array[float]"]]
) -> None:
    for name, column, numbers in columns:
        cell = row[column].strip() if column < len(row) else ""
        if not cell:
            continue
        if len(numbers) != line - _FIRST_ROW:
            raise InputError(f"import {path}: {name} is empty in line {len(numbers) + _FIRST_ROW}")
        try:
            numbers.append(float(cell))
        except ValueError as error:
            raise InputError(
                f"import {path}: {name} is {cell!r} in line {line}, it must be a number"
            ) from error


def _vectors(path: Path, columns: dict[str, FloatArray], channel: Channel) -> FloatArray | None:
    names = axis_columns(channel)
    lacking = [name for name in names if name not in columns]
    if len(lacking) == len(names):
        return None
    if lacking:
        raise InputError(f"import {path}: the column {lacking[0]} is missing")
    lengths = {len(columns[name]) for name in names}
    if len(lengths) > 1:
        raise InputError(f"import {path}: {', '.join(names)} end in different lines")
    return np.column_stack([columns[name] for name in names])
