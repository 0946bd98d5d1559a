"""MATLAB files: variables, and the fields of structures as ``structure.field``."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError, brief
from mmt.core.extras import require
from mmt.session.importing.columns import Columns
from mmt.session.importing.options import ImportOptions

_MOST_COMPONENTS = 16
"""Rows up to which an array that is wider than high has its samples along the columns."""


def read_matlab(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> Columns:
    """Read the wanted variables of a ``.mat`` file of any version, 7.3 by h5py.

    Vectors become (n,), and arrays whose samples stand along the columns are turned to
    (n, k). Tables and timetables are objects that only MATLAB reads; structures are not.

    Raises
    ------
    InputError
        The file is missing or not a MATLAB file, or it is of version 7.3 and h5py is missing.
    """
    origin = f"import {path}"
    try:
        variables = dict(_variables(path))
    except OSError as error:
        raise InputError(f"{origin}: {error.strerror or error}") from error
    except InputError:
        raise
    except Exception as error:  # damage reaches every part of the library
        raise InputError(f"{origin}: this is not a MATLAB file: {brief(error)}") from error
    return Columns(
        origin=origin,
        values={n: _upright(v) for n, v in variables.items() if wanted(n)},
        names=list(variables),
    )


def _variables(path: Path) -> Iterator[tuple[str, FloatArray]]:
    require("scipy")
    from scipy.io import loadmat

    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=True, appendmat=False)
    except NotImplementedError:  # version 7.3 is HDF5
        yield from _hdf5_variables(path)
        return
    for name, value in content.items():
        if not name.startswith("__"):
            yield from _flattened(name, value)


def _flattened(name: str, value: Any) -> Iterator[tuple[str, FloatArray]]:
    fields = getattr(getattr(value, "dtype", None), "names", None)
    if fields:
        for field in fields:
            inner = value[field]
            if isinstance(inner, np.ndarray) and inner.dtype == object and inner.shape == ():
                inner = inner.item()
            yield from _flattened(f"{name}.{field}", inner)
    elif isinstance(value, np.ndarray | np.number) and value.dtype.kind in "iufb":
        yield name, np.asarray(value, dtype=np.float64)


def _hdf5_variables(path: Path) -> Iterator[tuple[str, FloatArray]]:
    require("h5py")
    import h5py

    found: list[tuple[str, FloatArray]] = []

    def look(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf" and "#refs#" not in name:
            found.append((name.replace("/", "."), np.asarray(item, dtype=np.float64).T))

    with h5py.File(path, "r") as file:
        file.visititems(look)
    yield from found


def _upright(values: FloatArray) -> FloatArray:
    """Return vectors as (n,) and arrays as (n, k)."""
    values = np.squeeze(values)
    if values.ndim == 2 and values.shape[0] <= _MOST_COMPONENTS < values.shape[1]:
        return values.T
    return values
