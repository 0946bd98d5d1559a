"""Tables that tell sensors apart by a column: each sensor's rows become columns of their own."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.core.units import is_unit, unit_in_name
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
    try:
        columns = read(path, partial(_or_told, wanted), options)
    except InputError:  # in other files such names may stand for anything
        return read(path, wanted, options)
    keys = _keys(columns)
    if not keys:
        return _in_told_unit(columns)
    every = read(path, Wanted(columns.names), options)
    joined = ("_".join(filter(None, row)) for row in zip(*keys.values(), strict=False))
    labels = np.array(list(joined))
    sensors = [sensor for sensor in dict.fromkeys(labels.tolist()) if sensor]
    told = f"{' and '.join(keys)} tells {len(sensors)} sensors apart"
    if _is_one_stream(every, len(labels)):
        note = f"{told}, whose rows were left together: each holds several channels"
        return replace(columns, notes=(*columns.notes, note))
    if len(sensors) > _MOST:
        raise InputError(f"{columns.origin}: {told}, {_MOST} can be: keep what is needed")
    note = f"{told}: {', '.join(sensors[:SHOWN_COLUMNS])}"
    parts, units = _apart(every, keys, labels, sensors)
    return replace(
        every,
        values={name: column for name, column in parts.items() if wanted(name)},
        names=list(parts),
        units={name: unit for name, unit in units.items() if unit},
        row_name="row {} of its sensor, counted from 0".format,
        notes=(*every.notes, note),
        labels={},
    )


def _apart(
    columns: SourceColumns,
    keys: Collection[str],
    labels: npt.NDArray[np.str_],
    sensors: Sequence[str],
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the columns of each sensor, and their units."""
    parts, units = dict[str, Any](), dict(columns.units)
    told = [texts for texts in _told_units(columns) if len(texts) == len(labels)]
    for sensor in sensors:
        rows = labels == sensor
        unit = _one_unit(columns, [texts[rows] for texts in told], sensor)
        for name, column in columns.values.items():
            new = f"{sensor}.{name}"
            if not columns.ends_left_out and np.shape(column)[:1] != labels.shape:
                parts[name] = column
            elif name not in keys and np.isfinite(own := column[rows[: len(column)]]).any():
                parts[new] = own
                own_unit = "" if target_of(name) == "time" else unit
                units[new] = own_unit or units.get(name, "")
    return parts, units


def _or_told(wanted: Callable[[str], bool], name: str) -> bool:
    return tells_apart(name) or name.lower() in _UNITS or wanted(name)


def _keys(columns: SourceColumns) -> Mapping[str, list[str]]:
    """Return the labels of rows in columns that tell sensors apart, an axis last."""
    keys = {
        name: [text.strip("/") for text in texts.tolist()]
        for name, texts in columns.labels.items()
        if tells_apart(name) or (name.isdecimal() and _of_channels(texts))
    }
    for name, numbers in columns.values.items():
        if tells_apart(name, by_number=True) and numbers.ndim == 1:
            each = [f"{name}_{n:g}" if abs(n) < np.inf else "" for n in numbers.tolist()]
            keys |= {name: each} if len(set(each)) <= _MOST_NUMBERS else {}
    several = (n for n, t in keys.items() if 1 < len({*t} - {""}) <= len(t) / _FEWEST_ROWS)
    return {n: keys[n] for n in sorted(several, key=lambda name: name.lower() == "axis")}


def _channel_of(name: str) -> str:
    return quantity_of(target_of(name) or "")


def _of_channels(texts: Any) -> bool:
    return any(_channel_of(text) in CHANNELS for text in set(texts.tolist()))


def _is_one_stream(columns: SourceColumns, count: int) -> bool:
    """Return whether most of `count` rows hold several channels, at times that ascend."""
    filled = {channel: np.zeros(count, dtype=bool) for channel in CHANNELS}
    times: list[FloatArray] = []
    for name, column in columns.values.items():
        if (channel := _channel_of(name)) in filled and len(column) <= count:
            finite = np.isfinite(column).reshape(len(column), -1)
            filled[channel][: len(column)] |= finite.any(axis=1)
        elif channel == "time":
            times.append(column)
    several = sum(each.astype(int) for each in filled.values()) > 1
    return bool(np.mean(several) > 0.5) and all(np.all(np.diff(each) > 0) for each in times)


def _in_told_unit(columns: SourceColumns) -> SourceColumns:
    """Return the columns of one sensor in the unit that a column of units gives.

    It is not used if there are several channels, nor for names that end in a unit of their own.
    """
    told = _told_units(columns)
    channels = {name: _channel_of(name) for name in columns.names}
    if len(told) != 1 or len({*channels.values()} & {*CHANNELS}) > 1:
        return columns
    of_rows = columns.ends_left_out or len(told[0]) in map(len, columns.values.values())
    if not of_rows or not all(map(is_unit, {*told[0].tolist()} - {""})):
        return columns
    unit = _one_unit(columns, told, "the table")
    plain = (n for n, q in channels.items() if q != "time" and not (q and unit_in_name(q, n)))
    return replace(columns, units={**dict.fromkeys(plain, unit), **columns.units})


def _told_units(columns: SourceColumns) -> list[npt.NDArray[np.str_]]:
    return [texts for name, texts in columns.labels.items() if name.lower() in _UNITS]


def _one_unit(columns: SourceColumns, told: list[npt.NDArray[np.str_]], sensor: str) -> str:
    """Return the unit in columns of units, which must be one in all rows."""
    units = sorted({text for each in told for text in each.tolist() if text})
    if len(units) > 1:
        raise InputError(f"{columns.origin}: {sensor} is in {' and in '.join(units)}: keep one")
    return "".join(units)
