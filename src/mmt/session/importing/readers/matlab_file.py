"""Read MATLAB files: variables, and the fields of structures as ``structure.field``."""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.extras import require
from mmt.session.importing.column_names import gives_unit
from mmt.session.importing.columns import (
    OF_THE_SESSION,
    SourceColumns,
    beside_columns,
    distinct,
    reading,
)
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import columns_of, text_of
from mmt.session.importing.readers.hdf5_file import are_joined, of_object, read_hdf5

_OF_MMT: Final = {"sequence", "time_s"}
"""Variables that identify an exported session."""

_HEADS: Final = ("colheaders", "labels")
"""Names of the columns of ``data`` beside them, as of importdata and AcqKnowledge."""

_OF_SIMULINK: Final = {"values", "label"}
"""Fields of each signal in a ``Structure With Time``."""

_LARGEST_SPARSE: Final = 1 << 27
"""Elements; a sparse matrix may hold few of far more."""


def read_matlab(path: Path, wanted: Callable[[str], bool], options: ImportOptions) -> SourceColumns:
    """Read the wanted variables of a ``.mat`` file of any version, 7.3 by h5py.

    Numbers and vectors in a structure array or cell array are joined if their shapes are equal;
    other elements are named ``name{1}`` and on. Tables and timetables are objects that only MATLAB
    can read: they are left out with a note.

    Raises
    ------
    InputError
        The file is missing or not a MATLAB file, or is of version 7.3 and h5py is not installed.
    """
    require("scipy")
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabOpaque

    with reading("a MATLAB file"), warnings.catch_warnings():
        warnings.filterwarnings("ignore", 'Duplicate variable name "None"')  # of objects
        try:
            content = loadmat(path, squeeze_me=True, struct_as_record=True, appendmat=False)
        except NotImplementedError:  # version 7.3 is HDF5
            return read_hdf5(path, wanted, options)
        own = content.keys() & OF_THE_SESSION if content.keys() >= _OF_MMT else ()
        belongings = {name: content.pop(name) for name in own}
        beside = beside_columns(belongings)
    variables = {
        name: values
        for variable, content in content.items()
        if not variable.startswith("__")
        for name, values in _flattened(variable, content)
    }
    objects = {name: v.item() for name, v in variables.items() if isinstance(v, MatlabOpaque)}
    variables = {name: values for name, values in variables.items() if name not in objects}
    named, units = _named(variables)
    variables = {name: c for columns in named.values() for name, c in columns.items()} | variables
    return SourceColumns(
        names=[name for name in variables if name not in named],
        notes=[
            of_object(text_of(told[0]) if name == "None" else name, text_of(told[-2]))
            for name, told in objects.items()
        ],
        **columns_of({n: v for n, v in variables.items() if wanted(n)}, units),
        **beside,
    )


def _named(variables: Mapping[str, Any]) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """Return the columns of each matrix that are named beside it, as by importdata, and units."""
    named, units = dict[str, dict[str, Any]](), dict[str, str]()
    for name, data in variables.items():
        owner = name.removesuffix("data")
        if name == owner or np.ndim(data) != 2:
            continue
        beside = {n: np.ravel(variables.get(f"{owner}{n}", ())) for n in (*_HEADS, "units")}
        texts = {n: [*map(text_of, x)] for n, x in beside.items() if len(x) == data.shape[1]}
        if heads := next((texts[head] for head in _HEADS if head in texts), []):
            columns = [f"{owner}{head}" for head in distinct(heads)[0]]
            named[name] = dict(zip(columns, data.T, strict=True))
            units |= dict(zip(columns, texts.get("units", ()), strict=False))
    return named, units


def _flattened(name: str, value: Any) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    if hasattr(value, "toarray") and np.prod(value.shape) <= _LARGEST_SPARSE:
        value = value.toarray()
    value = np.asarray(value) if isinstance(value, str) else value
    kind = getattr(value, "dtype", None)
    if type(value).__name__ == "MatlabOpaque":
        yield name, value
    elif kind is not None and kind.names:
        if name.endswith(".signals") and _OF_SIMULINK.issubset(kind.names):
            yield from _signals(name.removesuffix(".signals"), np.ravel(value))
            return
        for field in kind.names:
            yield from _flattened(f"{name}.{field}", value[field])
    elif kind is not None and kind.hasobject and value.shape == ():
        yield from _flattened(name, value.item())
    elif kind is not None and kind.hasobject:
        yield from _in_cells(name, list(value.flat))
    elif kind is not None and kind.kind == "U" and (value.size > 1 or gives_unit(name)):
        yield name, value
    elif np.asarray(value).dtype.kind in "iufbc":
        yield name, np.asarray(value)


def _signals(owner: str, signals: npt.NDArray[Any]) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the values of each signal that Simulink wrote, by its label or its block's name."""
    blocks = signals["blockName" if "blockName" in (signals.dtype.names or ()) else "label"]
    names = [
        _text(label) or _text(block).rpartition("/")[2] or "values"
        for label, block in zip(signals["label"], blocks, strict=True)
    ]
    for label, each in zip(distinct(names)[0], signals, strict=True):
        yield from _flattened(f"{owner}.{label}", each["values"])


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""  # an empty text is read as an empty array


def _in_cells(name: str, elements: Sequence[Any]) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    if elements and all(isinstance(each, str) for each in elements):
        yield name, np.asarray(elements)
        return
    shapes = {getattr(each, "shape", ()) for each in elements}
    if are_joined(shapes, len(elements)):
        joined = np.asarray(elements)
        if joined.dtype.kind in "iufb":
            yield name, joined.astype(np.float64)
            return
    for number, each in enumerate(elements, start=1):
        yield from _flattened(f"{name}{{{number}}}", each)
