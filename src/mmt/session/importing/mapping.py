"""Map the columns of a recording to channels, in the units of frames."""

import re
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError
from mmt.core.frames import ALL_CHANNELS, CHANNELS, FIELD_OF_CHANNEL, Channel, axes_of
from mmt.core.units import DATE, QUANTITIES, unit_factor, unit_in_name
from mmt.session.data import FRAME_PERIOD_S, sample_times
from mmt.session.importing.column_names import components_mapped, ends_in, normalised
from mmt.session.importing.columns import MESSAGE_PARTS, SHOWN_COLUMNS, SourceColumns, listed
from mmt.session.importing.options import STANDARD_NAMES, ImportOptions, Source
from mmt.session.importing.samples import (
    PAUSE_S,
    Samples,
    continued,
    name_of,
    order_of,
    unfilled_rows,
)

_OF_FORMULAS: Final = "; a workbook's formulas have values once a spreadsheet program has saved it"

_OF_RATE: Final = "; for rows without times give --rate HZ"


def to_samples(columns: SourceColumns, options: ImportOptions) -> Samples:
    """Return the channels in the columns, in the units of frames.

    Raises
    ------
    InputError
        A column is missing or has a wrong shape, or there are no times.
    """
    return _Mapping(columns, options).samples()


def _to_length(values: FloatArray, length: int) -> FloatArray:
    """Return values (n, ...) with NaN at their end up to a length, if they are shorter."""
    blanks = np.full((max(0, length - len(values)), *values.shape[1:]), np.nan)
    return np.concatenate([values, blanks]) if len(blanks) else values


def _period_s(time_s: FloatArray) -> float:
    """Return the usual step of times (n,); the mean if most rows share a time with the last."""
    steps_s = np.diff(time_s) if len(time_s) > 1 else np.zeros(1)
    return float(np.median(steps_s) or np.mean(steps_s))


class _Mapping:
    def __init__(self, columns: SourceColumns, options: ImportOptions) -> None:
        self._columns = replace(columns, **_with_vectors(columns))
        self._options = components_mapped(options, self._columns.values)
        self._notes: dict[str, None] = {}
        self._told: set[str] = set()
        self._by_name: dict[str, str] = {}
        self._orders: dict[str, IntArray | None] = {}
        self._part = str(options.episode) if columns.episode is None else "None"
        self._has_part = options.episode is None or columns.episode is not None

    def samples(self) -> Samples:
        values: dict[Channel, FloatArray] = {}
        times: dict[Channel, FloatArray] = {}
        names = dict.fromkeys(ALL_CHANNELS, self._columns.row_name)
        sequence = self._columns.values.get("sequence")
        for channel in ALL_CHANNELS:
            vectors = self._vectors(channel)
            if vectors is None:
                continue
            name, time_s = self._time(channel, len(vectors))
            if self._columns.ends_left_out:
                vectors = _to_length(vectors, len(time_s))
            if len(time_s) != len(vectors):
                raise InputError(
                    f"{channel} has {len(vectors)} rows, its times "
                    f"({name}) {len(time_s)}{'' if len(time_s) else _OF_FORMULAS + _OF_RATE}"
                )
            if (order := self._order(time_s, name)) is not None:
                vectors, time_s = vectors[order], time_s[order]
                names[channel] = partial(name_of, names[channel], order)
            if vectors.ndim == 1:
                vectors = self._path(vectors, time_s)
            if vectors.ndim == 3:
                several = vectors.shape[1]
                steps_s = np.diff(time_s) if sequence is None else FRAME_PERIOD_S
                period_s = float(np.median(steps_s)) if len(time_s) > 1 else 0.0
                time_s = sample_times(time_s, several, period_s)
                rows = np.repeat(np.arange(len(vectors)), several)
                names[channel] = partial(name_of, names[channel], rows)
            values[channel] = vectors.reshape(-1, vectors.shape[-1])
            same = partial(np.array_equal, time_s, equal_nan=True)
            times[channel] = next(filter(same, times.values()), time_s)
        if not self._has_part:
            raise InputError(
                f"--episode {self._options.episode}: it has no such episode or "
                "trial, nor such a part whose time begins anew"
            )
        if not values:
            fields = ", ".join(FIELD_OF_CHANNEL[channel] for channel in CHANNELS)
            raise InputError(
                f"it holds none of {fields}, and "
                f"nothing is mapped to them (--map force_z=NAME); "
                f"{listed(self._columns.names)}; mmt session inspect proposes a command"
            )
        if self._by_name:
            units = ", ".join(list(self._by_name.values())[:SHOWN_COLUMNS])
            self._note(f"by the columns' names: {units}; --unit says another, as position_z=mm")
        return Samples(
            values=values,
            times=times,
            row_names={channel: names[channel] for channel in values},
            sequence=sequence,
            notes=tuple(self._notes),
            told=frozenset(self._told),
        )

    def _vectors(self, channel: Channel) -> FloatArray | None:
        """Return a channel (n, 3), or (n, k, 3) for k samples per row; None if it is missing.

        If a speed (n,) is mapped in place of position, that is returned.
        """
        if channel == "orientation":
            turns = self._of_axes(channel)
            return None if turns is None else normalised(turns)
        mapped = self._options.columns
        by_axes = channel not in mapped and any(f"{channel}_{a}" in mapped for a in "xyz")
        whole = None if by_axes else self._column(channel, channel)
        if whole is not None:
            if whole.ndim == 1 and channel != "position":
                self._note(f"{channel} is one number a row, which was taken along z, the normal")
                return np.column_stack([0.0 * whole, 0.0 * whole, whole])
            if whole.ndim != 2 or whole.shape[1] != 3:
                raise InputError(
                    f"{channel} has shape {whole.shape}, it must have shape "
                    f"(n, 3); a column of it is mapped as in --map {channel}_x=NAME[0]"
                )
            return whole
        joined = self._of_axes(channel)
        if joined is None and channel == "position" and "speed" in mapped:
            return self._column("speed", "speed")
        return joined

    def _of_axes(self, channel: Channel) -> FloatArray | None:
        """Return a channel whose components are columns of their own, or None if it has none."""
        axes = {axis: self._column(f"{channel}_{axis}", channel) for axis in axes_of(channel)}
        given = {axis: values for axis, values in axes.items() if values is not None}
        if not given:
            return None
        for axis in axes:
            if axis not in given:
                raise InputError(
                    f"{channel}_{axis} is missing (the column "
                    f"{STANDARD_NAMES[f'{channel}_{axis}']}); map it, to 0 where there is none: "
                    f"--map {channel}_{axis}=0"
                )
        if self._columns.ends_left_out:
            longest = max((len(values) for values in given.values() if values.ndim), default=0)
            given |= {
                a: _to_length(values, longest)
                for a, values in given.items()
                if values.ndim and len(values)
            }
        given = self._in_rows_of_the_first(channel, given)
        shapes = {values.shape for values in given.values() if values.ndim}
        if len(shapes) != 1:
            empty = next((axis for axis, values in given.items() if values.shape == (0,)), None)
            if empty is not None:
                raise InputError(f"{channel}_{empty} has no value in any row{_OF_FORMULAS}")
            sizes = ", ".join(" x ".join(map(str, shape)) for shape in sorted(shapes))
            raise InputError(
                f"the axes of {channel} end in different rows: {sizes or 'all are constants'}"
            )
        shape = shapes.pop()
        return np.stack([np.broadcast_to(given[axis], shape) for axis in axes], axis=-1)

    def _in_rows_of_the_first(
        self, channel: Channel, axes: dict[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Return axes with times of their own in the rows of the first of them, and note it.

        Each row has the nearest value, within half a period; if there is none, it is blank.
        """
        if self._options.rate_hz is not None or not self._columns.times:
            return axes
        first, first_s = self._stamps(channel) or ("", np.zeros(0))
        moved = dict(axes)
        for axis, values in axes.items() if first in self._columns.times else ():
            source = self._source(f"{channel}_{axis}", channel)
            name = source.name if isinstance(source, Source) else first
            time_s = self._columns.times.get(name, first_s)
            half_s = min(map(_period_s, (first_s, time_s))) / 2  # one of them may lack many rows
            alike = len(time_s) == len(first_s) and np.all(np.abs(time_s - first_s) <= half_s)
            sound = (
                len(time_s) and values.shape[:1] == time_s.shape and np.all(np.diff(time_s) >= 0)
            )
            if alike or not sound:
                continue
            near = np.searchsorted((time_s[1:] + time_s[:-1]) / 2, first_s)
            moved[axis] = np.array(values[near], dtype=np.float64)
            moved[axis][np.abs(time_s[near] - first_s) > half_s] = np.nan
            self._note(f"{name} has other times than {first}: of its values the nearest were taken")
        return moved

    def _path(self, speed: FloatArray, time_s: FloatArray) -> FloatArray:
        """Integrate a speed (n,), mapped in place of position, to positions (n, 3) along x."""
        steps_mm = np.diff(time_s) * (speed[1:] + speed[:-1]) / 2
        x_mm = np.where(np.isfinite(speed), np.nancumsum([0.0, *steps_mm]), np.nan)
        self._note(
            f"position was made of {self._options.columns['speed']}: a straight path along x"
        )
        return np.column_stack([x_mm, 0.0 * x_mm, 0.0 * x_mm])

    def _column(self, target: str, quantity: str) -> FloatArray | None:
        """Return a target's values in the unit of frames, shape () for a constant, or None."""
        source = self._source(target, quantity)
        if isinstance(source, float) and quantity == "time":
            raise InputError(
                f"{target} is mapped to the number {source:g}, it must be a "
                "column; for a file without times give --rate HZ"
            )
        if source is None or isinstance(source, float):
            return None if source is None else np.array(source)
        values = self._columns.values[source.name]
        if source.component is not None:
            if values.ndim != 2 or source.component >= values.shape[1]:
                raise InputError(
                    f"{target} is mapped to component {source.component} of "
                    f"{source.name}, which has shape {values.shape}; components count from 0"
                )
            values = values[:, source.component]
        sampled = quantity == "acceleration" and target not in self._options.columns
        lacks_rows = quantity in ("time", "speed") and values.ndim == 0
        if target not in ALL_CHANNELS and (values.ndim > 1 + sampled or lacks_rows):
            raise InputError(
                f"{source.name} has shape {values.shape}, it must have shape (n,) "
                f"for {target}; a component is mapped as in --map {target}={source.name}[0]"
            )
        factor = source.factor * self._factor(target, quantity, source)
        scaled = values if factor == 1.0 else factor * values
        if target.endswith("time"):
            scaled = self._with_fraction(target, source.name, scaled)
            name = self._options.columns.get(target, source.name)
            if self._order(scaled, name) is None:
                scaled = self._continued(scaled, name, source.name, abs(factor))
        return scaled

    def _continued(self, time_s: FloatArray, name: str, column: str, count_s: float) -> FloatArray:
        """Return times (n,) that go on where they fell; note it, or select the part asked for."""
        of_day = self._columns.units.get(column) == DATE
        whole_s, notes = continued(time_s, count_s, of_day=of_day)
        begins = np.flatnonzero((np.diff(time_s) < 0) & np.isclose(np.diff(whole_s), PAUSE_S)) + 1
        parts = dict(enumerate(np.split(np.arange(len(time_s)), begins), start=1))
        part = next((rows for number, rows in parts.items() if str(number) == self._part), None)
        if len(begins) and part is not None:
            self._orders[name], self._has_part = part, True
        else:
            self._note(*(f"{column} {note}" for note in notes))
        return whole_s

    def _with_fraction(self, target: str, name: str, seconds_s: FloatArray) -> FloatArray:
        """Return times with the parts of a second that are mapped to be added to them."""
        added_s = self._column("time_fraction", "time") if target == "time" else None
        if added_s is None:
            return seconds_s
        if added_s.shape != seconds_s.shape or not np.array_equal(
            seconds_s, np.rint(seconds_s), equal_nan=True
        ):
            raise InputError(
                f"time_fraction is added to whole seconds, one a row; {name}, to "
                "which time is mapped, does not hold these"
            )
        return seconds_s + added_s

    def _source(self, target: str, quantity: str) -> Source | float | None:
        """Return the column of a target, or its constant, or None if it has neither."""
        columns, names = self._columns.values, self._columns.names
        source = self._options.source(target, columns)
        asked = source or Source(STANDARD_NAMES[target])
        if asked.name in columns:
            return asked
        if asked.name in self._columns.labels:
            text = max(self._columns.labels[asked.name].ravel().tolist(), key=len)
            raise InputError(
                f"{asked.name} does not hold numbers: {text[:40]!r} is none, nor a "
                "date as 2026-01-31 10:30:00.5; --missing says what stands for none"
            )
        dotted = f"{asked.name}."
        doubled = [n for n in names if n.startswith(dotted) and n[len(dotted) :].isdecimal()]
        if len(doubled) > 1 and not set(doubled) - set(columns):
            raise InputError(
                f"{asked.name} stands in {len(doubled)} columns: which of "
                f"{', '.join(doubled[:SHOWN_COLUMNS])} is it? (--map {target}=NAME)"
            )
        if source is None:
            return None
        text = self._options.columns[target]
        numbered = bool(names) and all(name.isdecimal() for name in names)
        if numbered and text.isdecimal() and int(text):
            raise InputError(
                f"{target} is mapped to column {text}, which is not there; "
                f"{listed(names)} (a constant is written {text}.0)"
            )
        try:
            return float(text)
        except ValueError:
            pass
        within = [name for name in columns if name.startswith(f"{source.name}.")]
        if target == quantity:  # the target is a vector, not a single axis
            within = [name for name in within if columns[name].shape[1:] == (3,)]
        if len(within) > 1:
            parts = MESSAGE_PARTS.get(quantity, (quantity,))
            within = [name for name in within if ends_in(name, parts)]
        if len(within) == 1:
            return replace(source, name=within[0])
        told = (note for note in self._columns.notes if note.startswith(f"{source.name} "))
        why = next(told, "")[len(source.name) + 1 :] if source.name in names else ""
        raise InputError(
            f"{target} is mapped to {source.name}, which {why or 'is not there'}; {listed(names)}"
        )

    def _factor(self, target: str, quantity: str, source: Source) -> float:
        """Return the factor to the unit of frames, by the options, the file or the name."""
        if quantity == "orientation":
            return 1.0
        name, told = source.name, self._columns.units.get(source.name)
        given = self._options.units.get(target) or self._options.units.get(quantity)
        words = f"in {name}" if target == "time_fraction" else name  # which may be the unit alone
        unit = told if told == DATE else given or told or unit_in_name(quantity, words)
        factor = unit_factor(quantity, unit) if unit else 1.0
        if told or (unit and name not in STANDARD_NAMES.values()):
            self._told.add(quantity)
        if factor is not None:
            if factor != 1.0 and not (given or told):
                self._by_name[name] = f"{name} in {unit}"
            return factor
        if source.factor == 1.0:
            raise InputError(
                f"{target} is mapped to {name}, which is in {unit!r} by the file; "
                f"of {quantity}, known are {QUANTITIES[quantity]}: say the unit (--unit "
                f"{target}=UNIT), or scale it to the first (--map {target}={name}*FACTOR)"
            )
        return 1.0

    def _time(self, channel: Channel, rows: int) -> tuple[str, FloatArray]:
        """Return the name and the times (n,) of a channel."""
        found, rate_hz = self._stamps(channel), self._options.rate_hz
        if rate_hz is None:
            if found is not None:
                return found
            raise InputError(
                f"there is no column time_s, nor one that is mapped to it (--map "
                f"time=NAME); for a file without times give --rate HZ; "
                f"{listed(self._columns.names)}"
            )
        if found is not None:
            span_s = float(np.ptp(found[1])) if len(found[1]) else 0.0
            self._note(
                f"there are {rate_hz:g} rows a second, as --rate says; {found[0]}, by which all "
                f"{rows} last {span_s:.6g} s, was left out"
            )
        return "row number", np.arange(rows) / rate_hz

    def _order(self, time_s: FloatArray, name: str) -> IntArray | None:
        """Return `order_of` times of a name, for rows without frame numbers, and note it."""
        columns = self._columns.values
        if name not in self._orders and "sequence" not in columns:
            alike = [column for column in columns.values() if column.shape[:1] == time_s.shape]
            if unfilled := unfilled_rows(time_s, alike):
                self._note(f"{name}: the last {unfilled} rows hold only zeros and were left out")
                self._orders[name] = np.arange(len(time_s) - unfilled)
                return self._orders[name]
            self._orders[name] = order = order_of(time_s, alike)
            if order is not None:
                twice = len(time_s) - len(order)
                left = f", and {twice} that were written twice were left out" if twice else ""
                self._note(f"{name} falls: the rows were put in the order of their times{left}")
        return self._orders.get(name)

    def _stamps(self, channel: Channel) -> tuple[str, FloatArray] | None:
        """Return the name and the times (n,) of a channel in the file, or None."""
        for target in (f"{channel}_time", "time"):
            column = self._column(target, "time")
            if column is not None:
                return self._options.columns.get(target, STANDARD_NAMES[target]), column
        targets = [channel, *(f"{channel}_{axis}" for axis in axes_of(channel))]
        for target in [*targets, *(["speed"] if "speed" in self._options.columns else [])]:
            source = self._source(target, channel)
            if isinstance(source, Source) and source.name in self._columns.times:
                return source.name, self._columns.times[source.name]
        return None

    def _note(self, *sentences: str) -> None:
        self._notes |= dict.fromkeys(sentences)


def _with_vectors(columns: SourceColumns) -> dict[str, Any]:
    """Return values, units and times, with columns a[0], a[1], ... also joined to an array a."""
    arrays: dict[str, list[tuple[int, str]]] = {}
    for name, column in columns.values.items():
        if (found := re.fullmatch(r"(.+)[\[(](\d+)[\])]", name)) and column.ndim == 1:
            arrays.setdefault(found[1], []).append((int(found[2]), name))
    values, units, times = dict(columns.values), dict(columns.units), dict(columns.times)
    for base, elements in arrays.items():
        names = [name for _, name in sorted(elements)]
        longest = max(len(values[name]) for name in names) if columns.ends_left_out else 0
        parts = [_to_length(values[name], longest) for name in names]
        alike = len({units.get(name) for name in names}) == len({*map(len, parts)}) == 1
        if alike and base not in values:
            values[base] = np.column_stack(parts)
            units |= {base: units[names[0]]} if names[0] in units else {}
            clocks = [times[name] for name in names if name in times]
            if len(clocks) == len(names) and all(np.array_equal(clocks[0], c) for c in clocks):
                times[base] = clocks[0]
    return {"values": values, "units": units, "times": times}
