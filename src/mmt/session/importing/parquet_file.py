"""Read Parquet files: columns of numbers and of lists of numbers, and exported sessions."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.frames import ALL_CHANNELS, FIELD_OF_CHANNEL, MOST_SAMPLES, frame_dtype
from mmt.core.units import DATE
from mmt.session.data import field_columns
from mmt.session.importing.columns import (
    OF_THE_SESSION,
    SourceColumns,
    beside_columns,
    reading,
)
from mmt.session.importing.options import ImportOptions

_COUNTS: Final = range(1, MOST_SAMPLES + 1)
_OF_FRAMES: Final = {
    *("sequence", "time_ns"),
    *(name for c in ALL_CHANNELS for count in _COUNTS for name in field_columns(c, count)),
}
_TICKS: Final = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def read_parquet(
    path: Path, wanted: Callable[[str], bool], _options: ImportOptions
) -> SourceColumns:
    """Read the wanted columns of a ``.parquet`` file; of an exported session also scene and so on.

    A column of lists of k numbers each becomes an array (n, k).

    Raises
    ------
    InputError
        pyarrow is not installed, the file is missing or not Parquet, a wanted column does not
        hold numbers, or the session's scene or events are not valid.
    """
    origin = f"import {path}"
    names, metadata, dated = read_schema(path, origin)
    values = read_numbers([path], [name for name in names if wanted(name)], origin)
    stored = {n: metadata.get(f"mmt.{n.removesuffix('_json')}".encode()) for n in OF_THE_SESSION}
    own = _OF_FRAMES & set(names) if _is_session(names) else ()
    return SourceColumns(
        origin=origin,
        values={name: column.astype(np.float64) for name, column in values.items()},
        names=names,
        units=dict.fromkeys(dated, DATE),
        frames=_frames(read_numbers([path], own, origin)) if own else None,
        **beside_columns(stored, origin),
    )


def read_schema(path: Path, origin: str) -> tuple[list[str], Mapping[bytes, bytes], list[str]]:
    """Return the names of a file's columns, its metadata, and the names of columns of times.

    Raises
    ------
    InputError
        pyarrow is not installed, or the file is missing or not Parquet.
    """
    schema = _read(lambda parquet: parquet.read_schema(path), origin)
    dated = [field.name for field in schema if hasattr(field.type, "unit")]
    return list(schema.names), schema.metadata or {}, dated


def read_numbers(
    paths: Sequence[Path],
    names: Iterable[str],
    origin: str,
    filters: Sequence[tuple[str, str, int]] | None = None,
) -> dict[str, npt.NDArray[Any]]:
    """Return columns, (n,) or (n, k), of files with equal columns, concatenated.

    Parameters
    ----------
    paths
        The files.
    names
        Columns to read; may be empty.
    origin
        Name of the source in error messages.
    filters
        Conditions on rows, as in `pyarrow.parquet.read_table`.

    Raises
    ------
    InputError
        See `read_parquet`.
    """
    names = list(names)
    if not names:
        return {}
    files = [str(path) for path in paths]
    table = _read(lambda parquet: parquet.read_table(files, columns=names, filters=filters), origin)
    return {name: _numbers(table.column(name), name, origin) for name in names}


def _read(read: Callable[[Any], Any], origin: str) -> Any:
    require("pyarrow")
    import pyarrow
    import pyarrow.parquet

    with reading(origin, "a Parquet file", (OSError, pyarrow.ArrowException)):
        return read(pyarrow.parquet)


def _numbers(column: Any, name: str, origin: str) -> npt.NDArray[Any]:
    import pyarrow as pa
    import pyarrow.compute as pc

    kind, array = column.type, column.combine_chunks()
    if isinstance(array, pa.ChunkedArray):  # the table is empty
        array = pa.concat_arrays(array.chunks) if array.chunks else pa.array([], kind)
    lists = pa.types.is_list(kind) or pa.types.is_large_list(kind)
    if lists or pa.types.is_fixed_size_list(kind):
        flat, rows = array.flatten(), len(array)
        width = len(flat) // rows if rows else 0
        if not set(pc.list_value_length(array).to_pylist()) <= {width}:
            raise InputError(f"{origin}: the lists of {name} are not all of one length")
        return _numbers(pa.chunked_array([flat]), name, origin).reshape(rows, width)
    if hasattr(kind, "unit"):  # a date, a time of day, a duration
        ticks = pc.cast(array, pa.int32() if pa.types.is_time32(kind) else pa.int64())
        seconds: npt.NDArray[Any] = ticks.to_numpy(zero_copy_only=False).astype(np.float64)
        return seconds / _TICKS[kind.unit]
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)):
        raise InputError(f"{origin}: {name} holds {kind}, not numbers")
    numbers: npt.NDArray[Any] = array.to_numpy(zero_copy_only=False)
    return numbers.astype(np.float64) if numbers.dtype == object else numbers


def _is_session(names: Sequence[str]) -> bool:
    return {"sequence", "time_ns", "time_s"} <= set(names)


def _frames(columns: Mapping[str, npt.NDArray[Any]]) -> RecordArray | None:
    """Return the frames (n,) of an exported session, or None if the columns were changed."""
    counts = {
        c: count
        for c in ALL_CHANNELS
        for count in _COUNTS
        if set(field_columns(c, count)) <= columns.keys()
    }
    channels = list(counts)
    kinds: dict[str, type[np.generic]] = {"sequence": np.uint32, "time_ns": np.int64}
    kinds |= dict.fromkeys((n for c in channels for n in field_columns(c, counts[c])), np.float32)
    if not channels or any(columns[name].dtype != kind for name, kind in kinds.items()):
        return None
    dtype = frame_dtype(channels, counts.get("acceleration", 1))
    frames = np.zeros(len(columns["sequence"]), dtype=dtype)
    frames["sequence"], frames["time_ns"] = columns["sequence"], columns["time_ns"]
    for channel in channels:
        names = field_columns(channel, counts[channel])
        values = frames[FIELD_OF_CHANNEL[channel]].reshape(len(frames), len(names))
        for place, name in enumerate(names):
            values[:, place] = columns[name]
    return frames
