"""Read Parquet files: columns of numbers and of lists of numbers, and exported sessions."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.frames import ALL_CHANNELS, MOST_SAMPLES
from mmt.session.data import field_columns, frames_of
from mmt.session.importing.columns import (
    OF_THE_SESSION,
    SourceColumns,
    beside_columns,
    reading,
    told_unit,
)
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import columns_of

_OF_FRAMES: Final = {
    *("sequence", "time_ns"),
    *(n for c in ALL_CHANNELS for k in (1, MOST_SAMPLES) for n in field_columns(c, k)),
}


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
    names, metadata, units = read_schema(path)
    values = read_numbers(path, [name for name in names if wanted(name)])
    stored = {n: metadata.get(f"mmt.{n.removesuffix('_json')}".encode()) for n in OF_THE_SESSION}
    own = _OF_FRAMES & set(names) if {"sequence", "time_ns", "time_s"} <= set(names) else ()
    return SourceColumns(
        names=names,
        **columns_of(values, units),
        frames=_frames(read_numbers(path, own)) if own else None,
        **beside_columns(stored),
    )


def read_schema(path: Path) -> tuple[list[str], Mapping[bytes, bytes], dict[str, str]]:
    """Return the names of a file's columns, its metadata, and the units in that of the columns.

    Raises
    ------
    InputError
        pyarrow is not installed, or the file is missing or not Parquet.
    """
    schema = _read(lambda parquet: parquet.read_schema(path))
    leaves = list(_leaves(schema))
    units = {name: told_unit(field.metadata or {}) for name, field in leaves}
    return [name for name, _ in leaves], schema.metadata or {}, units


def _leaves(fields: Iterable[Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield name and field of each column, of a structure those of its members."""
    for field in fields:
        if hasattr(field.type, "get_field_index"):
            yield from _leaves(field.type, f"{prefix}{field.name}.")
        else:
            yield f"{prefix}{field.name}", field


def read_numbers(path: Path, names: Iterable[str]) -> dict[str, npt.NDArray[Any]]:
    """Return columns, (n,) or (n, k), of a file; of lists within lists k is the number of all.

    They hold numbers, or what `mmt.session.importing.readers.cells.numbers_in` takes for such.

    Parameters
    ----------
    path
        The file.
    names
        Columns to read; may be empty.

    Raises
    ------
    InputError
        A column is not in the file, or see `read_parquet`.
    """
    names = list(names)
    if not names:
        return {}
    stored = _read(lambda parquet: parquet.read_schema(path).names)
    whole = [each for each in stored if any(f"{n}.".startswith(f"{each}.") for n in names)]
    table = _read(lambda parquet: parquet.read_table(path, columns=whole))
    while any(hasattr(kind, "get_field_index") for kind in table.schema.types):
        table = table.flatten()
    lacking = set(names) - set(table.column_names)
    if lacking:
        raise InputError(f"{path.name} has no column {', '.join(sorted(lacking))}")
    return {name: _numbers(table.column(name), name) for name in names}


def _read(read: Callable[[Any], Any]) -> Any:
    require("pyarrow")
    import pyarrow
    import pyarrow.parquet

    with reading("a Parquet file", (OSError, pyarrow.ArrowException)):
        return read(pyarrow.parquet)


def _numbers(column: Any, name: str) -> npt.NDArray[Any]:
    import pyarrow as pa
    import pyarrow.compute as pc

    kind, array = column.type, column.combine_chunks()
    if isinstance(array, pa.ChunkedArray):  # the table is empty
        array = pa.concat_arrays(array.chunks) if array.chunks else pa.array([], kind)
    lists = pa.types.is_list(kind) or pa.types.is_large_list(kind)
    if lists or pa.types.is_fixed_size_list(kind):
        given, flat = array.is_valid().to_numpy(zero_copy_only=False), array.flatten()
        width = len(flat) // given.sum() if given.any() else 0
        if not set(pc.list_value_length(array).to_pylist()) <= {width, None}:
            raise InputError(f"the lists of {name} are not all of one length")
        inner = _numbers(pa.chunked_array([flat]), name)
        rows = inner.reshape(-1, width * inner.size // max(1, len(inner)))
        if given.all():
            return rows
        spread = np.full((len(given), rows.shape[1]), np.nan)
        spread[given] = rows
        return spread
    numbers: npt.NDArray[Any] = array.to_numpy(zero_copy_only=False)
    return numbers


def _frames(columns: Mapping[str, npt.NDArray[Any]]) -> RecordArray | None:
    """Return the frames (n,) of an exported session, or None if the columns were changed."""
    several = sum(name.startswith("acceleration_x_m_s2[") for name in columns) or 1
    names = {channel: field_columns(channel, several) for channel in ALL_CHANNELS}
    values = {
        channel: np.column_stack([columns[name] for name in own])
        for channel, own in names.items()
        if columns.keys() >= {*own}
    }
    sequence, time_ns = columns["sequence"], columns["time_ns"]
    kinds = {sequence.dtype.str, time_ns.dtype.str, *(each.dtype.str for each in values.values())}
    if not values or kinds != {"<u4", "<i8", "<f4"}:
        return None
    return frames_of(sequence, time_ns, values, several)
