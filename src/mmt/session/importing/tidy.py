"""Tables that tell sensors apart by a column: each sensor's rows become columns of their own."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.arrays import BoolArray
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.core.units import is_unit
from mmt.session.importing.column_names import target_of, tells_apart
from mmt.session.importing.columns import SHOWN_COLUMNS, SourceColumns, Wanted
from mmt.session.importing.options import ImportOptions, quantity_of

_MOST: Final = 256
_MOST_NUMBERS: Final = 16
_UNITS: Final = ("unit", "units")
_FEWEST_ROWS: Final = 4
"""Least number of rows of a sensor, on average."""


def read_apart(
    read: Callable[..., SourceColumns],
    path: Path,
    wanted: Callable[[str], bool],
    options: ImportOptions,
) -> SourceColumns:
    """Call an importer; columns of a table with rows of several sensors become `SENSOR.COLUMN`.

    Raises
    ------
    InputError
        There are too many sensors, one has several units, or see `read`.
    """
    columns = read(path, partial(_or_key, wanted), options)
    if not _keys(columns):
        return _in_told_unit(columns)
    columns = read(path, Wanted(columns.names), options)
    keys, parts, units = _keys(columns), dict[str, Any](), dict(columns.units)
    joined = ("_".join(filter(None, row)) for row in zip(*keys.values(), strict=False))
    labels = np.array(list(joined))
    sensors = [sensor for sensor in dict.fromkeys(labels.tolist()) if sensor]
    told = f"{' and '.join(keys)} tells {len(sensors)} sensors apart"
    if len(sensors) > _MOST:
        raise InputError(f"{columns.origin}: {told}, {_MOST} can be: keep what is needed")
    for sensor in sensors:
        rows = labels == sensor
        unit = _unit(columns, rows, sensor)
        for name, column in columns.values.items():
            new = f"{sensor}.{name}"
            if not columns.ends_left_out and np.shape(column)[:1] != labels.shape:
                parts[name] = column
            elif name not in keys and np.isfinite(own := column[rows[: len(column)]]).any():
                parts[new] = own
                own_unit = "" if target_of(name) == "time" else unit
                units[new] = own_unit or units.get(name, "")
    return replace(
        columns,
        values={name: column for name, column in parts.items() if wanted(name)},
        names=list(parts),
        units={name: unit for name, unit in units.items() if unit},
        row_name="row {} of its sensor, counted from 0".format,
        notes=(*columns.notes, f"{told}: {', '.join(sensors[:SHOWN_COLUMNS])}"),
        labels={},
    )


def _or_key(wanted: Callable[[str], bool], name: str) -> bool:
    return tells_apart(name) or name.lower() in _UNITS or wanted(name)


def _in_told_unit(columns: SourceColumns) -> SourceColumns:
    """Return the columns of one sensor, in the unit that a column of units gives."""
    told = [
        text for name, texts in columns.labels.items() if name.lower() in _UNITS for text in texts
    ]
    if not told or not all(map(is_unit, filter(None, told))):
        return columns
    unit = _unit(columns, np.full(len(told), True), "the table")
    names = (name for name in columns.names if target_of(name) != "time")
    return replace(columns, units={**dict.fromkeys(names, unit), **columns.units})


def _of_channels(texts: Any) -> bool:
    return any(quantity_of(target_of(text) or "") in CHANNELS for text in set(texts.tolist()))


def _unit(columns: SourceColumns, rows: BoolArray, sensor: str) -> str:
    """Return the unit in a column of units, which must be one in all rows of a sensor."""
    texts = (texts[rows] for n, texts in columns.labels.items() if n.lower() in _UNITS)
    units = sorted({text for each in texts for text in each.tolist() if text})
    if len(units) > 1:
        raise InputError(f"{columns.origin}: {sensor} is in {' and in '.join(units)}: keep one")
    return "".join(units)


def _keys(columns: SourceColumns) -> Mapping[str, list[str]]:
    """Return the labels of rows in columns that tell sensors apart, an axis last."""
    keys = {
        name: [text.strip("/") for text in texts.tolist()]
        for name, texts in columns.labels.items()
        if texts.ndim == 1 and (tells_apart(name) or (name.isdecimal() and _of_channels(texts)))
    }
    for name, numbers in columns.values.items():
        if tells_apart(name, by_number=True):
            each = [f"{name}_{n:g}" if abs(n) < np.inf else "" for n in np.ravel(numbers).tolist()]
            keys |= {name: each} if len(set(each)) <= _MOST_NUMBERS else {}
    several = (n for n, t in keys.items() if 1 < len({*t} - {""}) <= len(t) / _FEWEST_ROWS)
    return {n: keys[n] for n in sorted(several, key=lambda name: name.lower() == "axis")}
