"""Read HDF5 files of any layout; a column's name is the data set's path, with dots, and field."""

import re
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from math import prod
from pathlib import Path
from pickletools import genops
from typing import Any, Final, TypeAlias

import numpy as np

from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.session.importing.column_names import unit_of_what
from mmt.session.importing.columns import (
    BEGAN,
    SHOWN_COLUMNS,
    SourceColumns,
    beside_columns,
    distinct,
    reading,
    text_in,
    told_unit,
)
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import columns_of

_SCALES: Final = {"scale_factor": 1.0, "add_offset": 0.0}
_BLANKS: Final = ("_FillValue", "missing_value")
_PACKING: Final = {*_SCALES, *_BLANKS}
"""Attributes of packed values, by the conventions of netCDF."""
_OTHER_SCALES: Final = re.compile(
    r"(scal(e|ing)|gain|calibration|sensitivity|slope)([ _]?factor)?|offset|factor", re.IGNORECASE
)
"""Matches attributes of values that programs of laboratories define for themselves."""
_NEUTRAL: Final = ("0", "0.0", "1", "1.0")
_UNNAMED: Final = b"N."
"""What pandas stores for the name of an index that has none."""
_Set: TypeAlias = tuple[str, Any, tuple[str | int, ...]]
"""Name of a column, its data set, and the path of the field within; a number is a column's."""
_OF_MMT: Final = {"sequence", "time_ns"}
"""Data sets that identify an exported session; in other files ``scene`` may be anything."""


def read_hdf5(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> SourceColumns:
    """Read the wanted data sets of a file; of an exported session also scene, events and so on.

    The attribute ``units`` of a data set is its unit; those of netCDF scale and offset packed
    values, and say which are missing.

    Raises
    ------
    InputError
        h5py is not installed, or the file is missing or not an HDF5 file.
    """
    require("h5py")
    import h5py

    with reading("an HDF5 file"), h5py.File(path, "r") as file:
        lost, of_groups = list[str](), dict[str, str]()
        sets = list(_data_sets(file, lost, of_groups))
        names, notes = distinct([name for name, _, _ in sets])
        read = {name: each for name, each in zip(names, sets, strict=True) if wanted(name)}
        unwritten = (_unwritten(name, item) for name, (_, item, _) in read.items())
        unused = (_unused(name, item) for name, (_, item, _) in read.items())
        notes = [*notes, *lost[:SHOWN_COLUMNS], *filter(None, (*unwritten, *unused))]
        values = {name: np.array(unit) for name, unit in of_groups.items() if wanted(name)}
        values |= {name: _values(file, item, fields) for name, (_, item, fields) in read.items()}
        told = {name: told_unit(item.attrs) for name, (_, item, _) in read.items()}
        exported = file.keys() >= _OF_MMT
        own = {"scene_json": "scene", "events_json": "events", "annotations": "annotations"}
        stored = {name: file[path][()] for name, path in own.items() if path in file and exported}
        stored |= {BEGAN: file.attrs.get(BEGAN)} if exported else {}
    columns = columns_of(values, told)
    return SourceColumns(names=names, notes=notes, **columns, **beside_columns(stored))


def _data_sets(
    group: Any,
    lost: list[str],
    units: dict[str, str],
    prefix: str = "",
    above: tuple[Any, ...] = (),
) -> Iterator[_Set]:
    """Yield the data sets of numbers, texts or references, also those behind links.

    Links to what is not there, and objects, are told in `lost`, the units of groups in `units`.
    """
    told = {"units": told_unit(group.attrs)}
    told |= {n: told_unit({"unit": text}) for n, text in group.attrs.items() if unit_of_what(n)}
    units |= {f"{prefix}{name}": unit for name, unit in told.items() if unit}
    for name, item in group.items():
        if "#" in name or name.startswith("_i_"):  # of MATLAB, of PyTables
            continue
        if item is None:
            link = group.get(name, getlink=True)
            where = " in ".join(filter(None, (link.path, getattr(link, "filename", ""))))
            lost.append(f"{prefix}{name} is a link to {where}, which is not there")
            continue
        for called, each in _in_cells(name, item):
            if not _is_set(each):
                if hasattr(each, "items") and each not in (*above, group):
                    yield from _data_sets(each, lost, units, f"{prefix}{called}.", (*above, group))
            elif "MATLAB_object_decode" in each.attrs:
                kind = text_in(each.attrs.get("MATLAB_class", ""))
                lost.append(of_object(f"{prefix}{called}", kind))
            elif each.shape is not None:
                yield from _columns_in(group, called, each, prefix)


def _in_cells(name: str, item: Any) -> Iterator[tuple[str, Any]]:
    """Yield an item, or what the references in it refer to, as ``name{1}`` if they are series."""
    cells = _behind(item) if _is_set(item) else []
    if not cells or (all(map(_is_set, cells)) and are_joined({*map(_sides, cells)}, len(cells))):
        yield name, item
        return
    for number, cell in enumerate(cells, start=1):
        yield from _in_cells(f"{name}{{{number}}}" if len(cells) > 1 else name, cell)


def _behind(item: Any) -> list[Any]:
    """Return what the references in a data set refer to; [] if it holds none."""
    import h5py

    if h5py.check_ref_dtype(item.dtype) is not h5py.Reference:
        return []
    return [item.file[reference] for reference in np.ravel(item[()]) if reference]


def _is_set(item: Any) -> bool:
    return hasattr(item, "dtype")


def _is_text(item: Any) -> bool:
    return text_in(item.attrs.get("MATLAB_class", "")) == "char"


def _sides(item: Any) -> tuple[int, ...]:
    return () if _is_text(item) else tuple(size for size in item.shape if size > 1)


def are_joined(shapes: Collection[tuple[int, ...]], count: int) -> bool:
    """Return whether arrays in so many cells are one column's rows, not each a series of its own.

    `shapes` are those of the cells without sides of one.
    """
    return len(shapes) == 1 and all(len(s) < 2 and max(s, default=1) <= count for s in shapes)


def of_object(name: str, kind: str) -> str:
    """Return a note on an object of MATLAB, such as a table, whose content is not documented."""
    return (
        f"{name} is a {kind} of MATLAB, which only MATLAB reads, and was left out: save its "
        "numbers, such as seconds(t), and a table T by s = table2struct(T, ToScalar=true), a "
        "timetable by timetable2table before"
    )


def _unused(name: str, item: Any) -> str:
    """Return a note if a data set has a scale that is none of netCDF's, which is not applied."""
    keys = [key for key in {*item.attrs} - _PACKING if _OTHER_SCALES.fullmatch(key)]
    told = {key: text_in(item.attrs[key]) for key in sorted(keys)}
    found = ", ".join(f"{key} {text}" for key, text in told.items() if text not in _NEUTRAL)
    return f"{name}: its {found} is not applied (--map TARGET={name}*FACTOR)" if found else ""


def _columns_in(group: Any, name: str, item: Any, prefix: str) -> Iterator[_Set]:
    told = item.attrs.get("name", _UNNAMED) if name == "axis1" else _UNNAMED
    own = name if told == _UNNAMED else text_in(told)
    for fields in _fields(item.dtype):
        columns = _names_by_pandas(group, name, item, fields)
        for place, column in enumerate(columns):
            path = [*(own, *fields)[:-1], column]
            yield f"{prefix}{'.'.join(path)}", item, (*fields, place)
        if not columns:
            yield f"{prefix}{'.'.join((own, *fields))}", item, fields


def _names_by_pandas(group: Any, name: str, item: Any, fields: tuple[str, ...]) -> list[str]:
    """Return the names of an array's columns that pandas stores beside it; [] if there are none.

    Those of a table are pickled: of their code the texts are taken, and it is not run.
    """
    names, kind = list[str](), item.attrs.get(f"{fields[0]}_kind") if len(fields) == 1 else None
    if isinstance(kind, bytes) and kind.startswith(b"(l"):
        with suppress(ValueError):
            names = [str(text) for code, text, _ in genops(kind) if code.name == "UNICODE"]
    elif not fields and (told := name.replace("_values", "_items")) in group and told != name:
        names = [text_in(text) for text in np.ravel(group[told][()])]
    shape = item.dtype[fields[0]].shape if fields else item.shape[1:]
    return names if shape == (len(names),) or _is_pickled(item) else []


def _is_pickled(item: Any) -> bool:
    """Return whether a data set holds an array that PyTables pickled, as of texts."""
    return text_in(item.attrs.get("PSEUDOATOM", "")) == "object" and item.shape == (1,)


def _pickled(item: Any) -> Any:
    """Return the texts and numbers (n, k) in a pickled array, whose code is not run."""
    memory, stack, found, begin = dict[Any, Any](), list[Any](), list[Any](), 0
    for code, value, _ in genops(item[0].tobytes()):
        if code.name == "MEMOIZE" or code.name.endswith("PUT"):
            memory[len(memory) if value is None else value] = stack[-1]
        elif code.name == "MARK":
            begin = len(stack)
        elif code.name == "APPENDS":
            found += stack[begin:]
        elif code.name.endswith("GET"):
            stack.append(memory[value])
        else:
            stack.append(... if value is None and code.name != "NONE" else value)
    if any(each is ... for each in found):
        raise InputError(f"{item.name} holds pickled objects other than texts and numbers")
    items = item.name.rpartition("/")[2].replace("_values", "_items")
    return np.array(found, dtype=object).reshape(-1, item.parent[items].size)


def _unwritten(name: str, item: Any) -> str:
    """Return a note if values of a data set were never written, so that others are in their place.

    Raises
    ------
    InputError
        They stand in another file, which is not there.
    """
    if item.is_virtual:
        folder = Path(item.file.filename).parent
        parts = dict.fromkeys(part.file_name for part in item.virtual_sources())
        named = (part for part in parts if part != "." and "%b" not in part)  # a file each block
        gone = [part for part in named if not (folder / part).is_file()]
        if gone:
            raise InputError(f"{name} is put together of other files; there is no {gone[0]}")
        return ""
    if item.chunks is None:
        whole, written = 1, min(1, item.id.get_storage_size())
    else:
        sides = zip(item.shape, item.chunks, strict=True)
        whole, written = prod(-(-size // chunk) for size, chunk in sides), item.id.get_num_chunks()
    if not item.size or written == whole:
        return ""
    return (
        f"{name}: {whole - written} of its {whole} parts were never written; they hold fill values"
    )


def _fields(kind: Any) -> Iterator[tuple[str, ...]]:
    """Yield the path of each field of numbers or texts in a type; () if the type is one itself."""
    for name in kind.names or ():
        yield from ((name, *fields) for fields in _fields(kind[name].base))
    if kind.kind in "iufbOS":
        yield ()


def _values(file: Any, item: Any, fields: tuple[str | int, ...]) -> Any:
    """Return values, unpacked by the attributes of netCDF; references by the arrays behind them."""
    import h5py

    named = [field for field in fields if isinstance(field, str)]
    values = _pickled(item) if _is_pickled(item) else np.asarray(item[(*named[:1],) or ()])
    for field in named[1:]:
        values = values[field]
    for column in fields[len(named) :]:
        values = values[:, int(column)]
    if values.dtype.kind == "O" and isinstance(next(iter(values.flat), None), h5py.Reference):
        return np.stack([np.squeeze(_values(file, file[each], ())) for each in values.flat if each])
    if values.dtype.kind in "iuf" and not _PACKING.isdisjoint(item.attrs):
        blank = [item.attrs[name] for name in _BLANKS if name in item.attrs]
        missing = np.isin(values, np.ravel(blank)) if blank else False
        scale, offset = (float(np.ravel(item.attrs.get(n, d))[0]) for n, d in _SCALES.items())
        values = np.where(missing, np.nan, scale * values + offset)
    if _is_text(item):
        return np.array("".join(map(chr, values.ravel())))
    return values.T if "MATLAB_class" in item.attrs else values
