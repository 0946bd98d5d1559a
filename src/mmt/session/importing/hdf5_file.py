"""Read HDF5 files of any layout; a column's name is the data set's path, with dots, and field."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.extras import require
from mmt.session.importing.columns import (
    BEGAN,
    SourceColumns,
    beside_columns,
    distinct,
    reading,
    text_in,
)
from mmt.session.importing.options import ImportOptions

_UNIT_ATTRIBUTES: Final = ("units", "unit", "Units", "Unit", "UNITS")
_OF_MMT: Final = {"sequence", "time_ns"}
"""Data sets that identify an exported session; in other files ``scene`` may be anything."""


def read_hdf5(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> SourceColumns:
    """Read the wanted data sets of a file; of an exported session also scene, events and so on.

    The attribute ``units`` of a data set is its unit.

    Raises
    ------
    InputError
        h5py is not installed, or the file is missing or not an HDF5 file.
    """
    origin = f"import {path}"
    require("h5py")
    import h5py

    with reading(origin, "an HDF5 file"), h5py.File(path, "r") as file:
        sets = list(_data_sets(file))
        names, notes = distinct([name for name, _, _ in sets])
        values, units = {}, {}
        for name, (_, item, field) in zip(names, sets, strict=True):
            if wanted(name):
                values[name] = _numbers(file, item[()] if field is None else item[field])
                units[name] = _unit(item)
        exported = file.keys() >= _OF_MMT
        own = {"scene_json": "scene", "events_json": "events", "annotations": "annotations"}
        stored = {name: file[path][()] for name, path in own.items() if path in file and exported}
        stored |= {BEGAN: file.attrs.get(BEGAN)} if exported else {}
    return SourceColumns(
        origin=origin,
        values=values,
        names=names,
        units={name: unit for name, unit in units.items() if unit},
        notes=notes,
        **beside_columns(stored, origin),
    )


def _data_sets(group: Any) -> Iterator[tuple[str, Any, str | None]]:
    """Yield name, data set and field (or None) for data sets of numbers or of references."""
    found: list[tuple[str, Any, str | None]] = []

    def look(path: str, item: Any) -> None:
        name = path.replace("/", ".")
        if "#" in path or not hasattr(item, "dtype"):  # "#" marks internal groups of MATLAB
            return
        fields = [n for n in item.dtype.names or () if item.dtype[n].base.kind in "iufb"]
        found.extend((f"{name}.{field}", item, field) for field in fields)
        if item.dtype.kind in "iufbO" and item.shape is not None:
            found.append((name, item, None))

    group.visititems(look)
    return iter(found)


def _numbers(file: Any, values: Any) -> FloatArray:
    """Return values as numbers; references are replaced by the stacked arrays behind them."""
    values = np.asarray(values)
    if values.dtype.kind == "O":
        values = np.stack([np.squeeze(file[reference][()]) for reference in values.flat])
    return np.asarray(values, dtype=np.float64)


def _unit(item: Any) -> str:
    told = next((item.attrs[name] for name in _UNIT_ATTRIBUTES if name in item.attrs), "")
    return ", ".join(dict.fromkeys(map(text_in, np.ravel(told))))
