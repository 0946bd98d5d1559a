"""Tables that tell trials or sensors apart by a column.

Of the trials one is read. Each sensor's rows become columns of their own.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import repeat, takewhile, zip_longest
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.core.units import is_unit, unit_in_name
from mmt.session.importing.column_names import (
    gives_unit,
    last_part,
    target_of,
    tells_apart,
    tells_trials,
    unit_name,
    unit_of_what,
)
from mmt.session.importing.columns import SHOWN_COLUMNS, SourceColumns, Wanted
from mmt.session.importing.options import ImportOptions, quantity_of
from mmt.session.importing.samples import name_of

_MOST: Final = 256
_MOST_NUMBERS: Final = 16
_MOST_UNEVEN: Final = 2.0
"""Numbers of sensors, each in any number of rows; ratio of rows of two sensors if they are more."""
_FEWEST_ROWS: Final = 4
"""Least number of rows of a sensor, on average."""
_OFTEN: Final = 0.25
_SELDOM: Final = 0.02
"""Shares of rows that change the label, of devices that take turns and of the states of one."""
_LEAP: Final = 5.0
"""Least size of a leap between devices, in steps of one."""


def read_apart(
    read: Callable[..., SourceColumns],
    path: Path,
    wanted: Callable[[str], bool],
    options: ImportOptions,
) -> SourceColumns:
    """Call an importer; columns of a table with rows of several sensors become `SENSOR.COLUMN`.

    Those of a group or topic become `GROUP.SENSOR.COLUMN`. Of several trials one is read.

    Raises
    ------
    InputError
        There is no such trial, there are too many sensors, one has several units, or see `read`.
    """
    read = partial(_read_besides, read, path, wanted, options)
    columns = read(_is_told)
    every = not any(map(wanted, columns.names))
    found = list(map(_keys, _tables(columns)))
    told = {_owner(k) for k in found if k and (every or _is_asked(k, columns.names, wanted))}
    unasked = (n for n in columns.times.keys() & columns.values if not wanted(n))
    others = {_topic_of(n) for n in unasked if n.startswith("/")} - told
    if not told and not others:
        return _in_told_unit(columns)
    names = {n for n in columns.names if not columns.times or _owner([n]) in told}
    columns = read(lambda n: n in names or (_is_told(n) and _topic_of(n) not in others))
    for table in list(_tables(columns)):
        keys = _keys(table)
        if keys and table.values.keys() - keys:
            columns = _taken_apart(columns, table, keys, wanted)
    values = {name: column for name, column in columns.values.items() if wanted(name)}
    return _in_told_unit(replace(columns, values=values))


def _read_besides(
    read: Callable[..., SourceColumns],
    path: Path,
    wanted: Callable[[str], bool],
    options: ImportOptions,
    others: Callable[[str], bool],
) -> SourceColumns:
    """Read what is wanted, and of `others` what can be read, of one trial."""
    try:
        columns = read(path, lambda name: wanted(name) or others(name), options)
    except InputError:
        plain = read(path, wanted, options)
        readable = set()
        for name in filter(others, plain.names):
            with suppress(InputError):
                readable |= {name} & {*read(path, Wanted([name]), options).names}
        columns = read(path, lambda name: wanted(name) or name in readable, options)
    for table in list(_tables(columns)):
        columns = _of_one_trial(columns, table, options.episode)
        numbers = _several(_numbers(table, partial(tells_apart, by_number=True)))
        doubtful = [name for name, cells in numbers.items() if not _are_of_sensors(cells)]
        notes = (f"{n}: its numbers, in few or many rows, are none of sensors" for n in doubtful)
        columns = replace(columns, notes=(*columns.notes, *notes))
    return columns


def _of_one_trial(
    columns: SourceColumns, table: SourceColumns, asked: int | str | None
) -> SourceColumns:
    """Return the columns with those rows of a table that are of the trial `asked` for, or of one.

    That is the first of those whose rows are one stretch, if any is. Labels that come back while
    time ascends are states of one recording.
    """
    keys = _several(
        {n: texts.tolist() for n, texts in table.labels.items() if tells_trials(n)}
        | _numbers(table, tells_trials)
    )
    if not keys:
        return columns
    labels = _labels(table, keys)
    stretches = Counter(labels[np.r_[True, labels[1:] != labels[:-1]]].tolist())
    trials = [trial for trial in stretches if trial]
    whole = [trial for trial in trials if stretches[trial] == 1]
    told = f"{' and '.join(keys)} tells {len(trials)} trials apart: {_shown(trials)}"
    if len(whole) < 2 and _ascend(_times_in(table)):
        note = f"{told}; as time goes on through all, they were left together"
        return replace(columns, notes=(*columns.notes, note))
    chosen = str([*whole, *trials][0] if asked is None else asked)
    if chosen not in trials:
        raise InputError(f"--episode {asked}: {told}")
    rows = labels == chosen
    kept = {
        field: {n: c[rows[: len(c)]] for n, c in getattr(table, field).items() if np.size(c) > 1}
        for field in ("values", "labels")
    }
    times = {id(clock): clock[rows] for n, clock in table.times.items() if n in table.names}
    note = f"{told}; this is {chosen}, --episode takes another"
    return replace(
        columns,
        values={**columns.values, **kept["values"]},
        labels={**columns.labels, **kept["labels"]},
        times={n: times.get(id(clock), clock) for n, clock in columns.times.items()},
        row_name=partial(name_of, columns.row_name, np.flatnonzero(rows))
        if len(table.names) == len({**columns.values, **columns.labels})
        else "row {} of its trial, counted from 0".format,
        notes=(*columns.notes, *([note] if asked is None else [])),
        episode=chosen,
    )


def _is_asked(
    keys: Mapping[str, list[str]], names: Sequence[str], wanted: Callable[[str], bool]
) -> bool:
    """Return whether the columns of a sensor are wanted, if they are of a topic.

    The clock is that of all topics that are read.
    """
    owner, sensors = _owner(keys), {*_joined(keys)} - {""}
    own = [name for name in names if _is_within(name, owner)]
    news = (_renamed(name, owner, sensor) for name in own for sensor in sensors)
    return not owner.startswith("/") or any(map(wanted, news))


def _labels(table: SourceColumns, keys: Mapping[str, list[str]]) -> npt.NDArray[np.str_]:
    """Return what the keys tell of each row of a table, as texts (n,)."""
    rows = max(map(len, (*table.values.values(), *table.labels.values())))
    return np.array([*_joined(keys), *repeat("", rows)])[:rows]


def _shown(labels: Sequence[str]) -> str:
    return ", ".join([*labels[:SHOWN_COLUMNS], *(["..."] if len(labels) > SHOWN_COLUMNS else [])])


def _joined(keys: Mapping[str, list[str]]) -> list[str]:
    """Return what the keys together tell of each row."""
    rows = zip_longest(*keys.values(), fillvalue="")
    return ["_".join(filter(None, row)) for row in rows]


def _renamed(name: str, owner: str, sensor: str) -> str:
    return f"{owner}.{sensor}{name.removeprefix(owner)}" if owner else f"{sensor}.{name}"


def _tables(columns: SourceColumns) -> Iterator[SourceColumns]:
    """Yield the columns that have their rows in common: those of one length and one clock."""
    tables: dict[object, list[str]] = {}
    for name, column in {**columns.values, **columns.labels}.items():
        length = () if columns.ends_left_out else np.shape(column)[:1]
        tables.setdefault((length, id(columns.times.get(name))), []).append(name)
    for names in tables.values():
        values = {n: columns.values[n] for n in names if n in columns.values}
        labels = {n: columns.labels[n] for n in names if n in columns.labels}
        yield replace(columns, values=values, labels=labels, names=names)


def _taken_apart(
    columns: SourceColumns,
    table: SourceColumns,
    keys: Mapping[str, list[str]],
    wanted: Callable[[str], bool],
) -> SourceColumns:
    """Return the columns with those of one table for each of its sensors; said if any is wanted."""
    labels = _labels(table, keys)
    sensors = [sensor for sensor in dict.fromkeys(labels.tolist()) if sensor]
    told = f"{' and '.join(keys)} tells {len(sensors)} sensors apart"
    if _is_one_stream(table, labels):
        note = f"{told}, whose rows were left together, as those of one device"
        said = [note] if any(map(wanted, table.values)) else []
        return replace(columns, notes=(*columns.notes, *said))
    if len(sensors) > _MOST:
        raise InputError(f"{told}, {_MOST} can be: keep what is needed")
    note = f"{told}: {_shown(sensors)}"
    if blank := int(np.sum(labels == "")):
        note += f"; {blank} rows that name none were left out"
    apart = _apart(table, keys, labels, sensors)
    left = {name for name in columns.names if name not in table.names}
    kept = {
        field: {n: x for n, x in getattr(columns, field).items() if n in left}
        | getattr(apart, field)
        for field in ("values", "units", "times", "labels")
    }
    names = [name for name in columns.names if name in left]
    return replace(
        columns,
        **kept,
        names=[*names, *apart.values],
        row_name="row {} of its sensor, counted from 0".format,
        notes=(*columns.notes, *([note] if any(map(wanted, apart.values)) else [])),
    )


def _apart(
    table: SourceColumns,
    keys: Collection[str],
    labels: npt.NDArray[np.str_],
    sensors: Sequence[str],
) -> SourceColumns:
    """Return the columns of each sensor in a table, with their units and times."""
    parts, units, times = dict[str, Any](), dict[str, str](), dict[str, Any]()
    told, owner = _told_units(table), _owner([*keys, *table.values])
    for sensor in sensors:
        rows = labels == sensor
        of_rows = (t if len(t) == 1 else t[rows[: len(t)]] for t in told.values())
        unit = _one_unit(list(of_rows), sensor)
        for name, column in table.values.items():
            if name in keys or not np.isfinite(own := column[rows[: len(column)]]).any():
                continue
            parts[new := _renamed(name, owner, sensor)] = own
            own_unit = "" if target_of(name) == "time" else unit
            units |= {new: text} if (text := own_unit or table.units.get(name, "")) else {}
            times |= {new: table.times[name][rows]} if name in table.times else {}
    return replace(table, values=parts, units=units, times=times, labels={})


def _is_told(name: str) -> bool:
    return tells_apart(name) or tells_trials(name) or gives_unit(name)


def _owner(names: Collection[str]) -> str:
    """Return the topic, or the innermost group, that all columns are in; "" if it is the file."""
    paths = [name.split(".")[: 1 if name.startswith("/") else -1] for name in names]
    shared = takewhile(lambda parts: len({*parts}) == 1, zip(*paths, strict=False))
    return ".".join(parts[0] for parts in shared)


def _topic_of(name: str) -> str:
    return _owner([name]).partition("@")[0]


def _is_within(name: str, owner: str) -> bool:
    return not owner or f"{name}.".startswith(f"{owner}.")


def _keys(table: SourceColumns) -> Mapping[str, list[str]]:
    """Return the labels of rows in columns that tell sensors apart, an axis last."""
    keys = {
        name: [text.strip("/") for text in texts.tolist()]
        for name, texts in table.labels.items()
        if tells_apart(name)
        or (name.isdecimal() and any(_channel_of(each) in CHANNELS for each in {*texts.tolist()}))
    }
    for name, cells in _numbers(table, partial(tells_apart, by_number=True)).items():
        each = [f"{last_part(name)}_{text}" if text else "" for text in cells]
        keys |= {name: each} if _are_of_sensors(cells) else {}
    rows = max((len(column) for column in table.values.values() if np.ndim(column)), default=0)
    several = [  # texts that stand in few rows are events
        n
        for n in _several(keys)
        if tells_apart(n, by_number=True) or 2 * sum(map(bool, keys[n])) >= rows
    ]
    return {n: keys[n] for n in sorted(several, key=lambda n: last_part(n).lower() == "axis")}


def _are_of_sensors(cells: Sequence[str]) -> bool:
    """Return whether numbers may be those of sensors: few, or as many rows of each.

    Readings of a sensor are many, and some are seldom.
    """
    counts = Counter(filter(None, cells))
    even = max(counts.values(), default=0) <= _MOST_UNEVEN * min(counts.values(), default=0)
    return len(counts) <= _MOST_NUMBERS or (even and all(map(str.isdecimal, counts)))


def _numbers(table: SourceColumns, tells: Callable[[str], bool]) -> dict[str, list[str]]:
    """Return the columns of numbers whose names say that they tell something, as texts."""
    found = {n: c.tolist() for n, c in table.values.items() if c.ndim == 1 and tells(n)}
    return {n: [f"{x:.15g}" if abs(x) < np.inf else "" for x in c] for n, c in found.items()}


def _several(keys: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """Return the columns of labels that differ, each in enough rows."""
    counts = {name: len({*texts} - {""}) for name, texts in keys.items()}
    return {n: t for n, t in keys.items() if 1 < counts[n] <= len(t) / _FEWEST_ROWS}


def _times_in(table: SourceColumns) -> list[FloatArray]:
    """Return the times (n,) of a table's rows: those of messages, and columns of that name."""
    of_messages = [table.times[name] for name in table.values if name in table.times]
    return of_messages[:1] + [c for n, c in table.values.items() if _channel_of(n) == "time"]


def _ascend(times: Iterable[FloatArray]) -> bool:
    return all(np.all(np.diff(each) > 0) for each in times)


def _channel_of(name: str) -> str:
    return quantity_of(target_of(name) or "")


def _is_one_stream(table: SourceColumns, labels: npt.NDArray[np.str_]) -> bool:
    """Return whether rows at times that ascend are of one device, whose states are labelled.

    Most of them hold several channels, or the labels seldom change; and no values leap then.
    """
    filled = {channel: np.zeros(len(labels), dtype=bool) for channel in CHANNELS}
    times = _times_in(table)
    for name, column in table.values.items():
        if (channel := _channel_of(name)) in filled:
            finite = np.isfinite(column).reshape(len(column), -1)
            filled[channel][: len(column)] |= finite.any(axis=1)
    several = bool(np.mean(sum(each.astype(int) for each in filled.values()) > 1) > 0.5)
    turns = labels[1:] != labels[:-1]
    if not _ascend(times):
        return False
    if several:
        measured = [c for n, c in table.values.items() if _channel_of(n) in CHANNELS]
        return bool(np.mean(turns) < _OFTEN) or not _leap(measured, labels, turns)
    others = [c for n, c in table.values.items() if _channel_of(n) != "time" and not tells_apart(n)]
    return bool(times) and bool(np.mean(turns) < _SELDOM) and not _leap(others, labels, turns)


def _leap(
    columns: Iterable[FloatArray], labels: npt.NDArray[np.str_], turns: npt.NDArray[np.bool_]
) -> bool:
    """Return whether a column (n,) leaps at `turns` (n - 1,) from one label to another."""
    for column in columns:
        if len(column) == len(labels):
            leaps = np.abs(np.diff(column, axis=0))[turns]
            own = [np.abs(np.diff(column[labels == label], axis=0)) for label in {*labels}]
            sizes = [each[np.isfinite(each)] for each in (leaps, np.concatenate(own))]
            if all(map(len, sizes)) and np.median(sizes[0]) > _LEAP * np.median(sizes[1]):
                return True
    return False


def _in_told_unit(columns: SourceColumns) -> SourceColumns:
    """Return the columns of one sensor in the unit that a column of units beside them gives.

    It is not used if there are several channels, nor for names that end in a unit of their own.
    """
    units, told, notes = dict(columns.units), _told_units(columns), list(columns.notes)
    plain = {n: _channel_of(n) for n in columns.names if n not in units}
    plain = {n: q for n, q in plain.items() if not (q and unit_in_name(q, n))}
    beside = Counter((_owner([unit_name(name)]), unit_of_what(name)) for name in told)
    for name, texts in sorted(told.items(), key=lambda each: -each[0].count(".")):
        owner, quantity = _owner([unit_name(name)]), unit_of_what(name)
        channels = {n: _channel_of(n) for n in columns.names if _is_within(n, owner)}
        read = (columns.values[n] for n in channels if n in columns.values)
        lengths = [1, *(len(np.atleast_1d(column)) for column in read)]
        of_rows = columns.ends_left_out or len(texts) in lengths
        several = not quantity and len({*channels.values()} & {*CHANNELS}) > 1
        own = [n for n in plain if unit_name(name).lower().removesuffix("s") == f"{n}_unit".lower()]
        certain = own or (not several and beside[owner, quantity] == 1)
        if certain and of_rows and all(map(is_unit, {*texts.tolist()} - {""})):
            unit = _one_unit([texts], "the table")
            fits = [quantity, ""] if quantity else [*CHANNELS, "", "orientation", "speed"]
            of_it = own or [n for n in channels if n in plain and channels[n] in fits]
            units = {**dict.fromkeys(of_it, unit), **units}
        elif {plain.get(n) for n in channels} & {quantity, *CHANNELS}:
            notes.append(f"{name} was not taken for the unit of columns (--unit says theirs)")
    return replace(columns, units=units, notes=notes)


def _told_units(columns: SourceColumns) -> dict[str, npt.NDArray[np.str_]]:
    return {name: texts for name, texts in columns.labels.items() if gives_unit(name)}


def _one_unit(told: list[npt.NDArray[np.str_]], sensor: str) -> str:
    """Return the unit in columns of units, which must be one in all rows."""
    units = sorted({text for each in told for text in each.tolist() if text})
    if len(units) > 1:
        raise InputError(f"{sensor} is in {' and in '.join(units)}: keep one")
    return "".join(units)
