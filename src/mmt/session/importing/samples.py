"""The channels of a recording with their times, checked."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError
from mmt.core.frames import Channel, axes_of
from mmt.core.quaternions import LARGEST_OFF

_LONGEST_S = 4_200_000.0
"""Longest session, limited by frame numbers of 32 bits."""

_LARGEST = float(np.finfo(np.float32).max)
"""Frames are in single precision."""

_COUNTS: Final = (2.0**8, 2.0**16, 2.0**24, 2.0**32)
"""Counts at which a counter wraps."""
_FIELD_S: Final = 1.0
"""Time at which the parts of a second wrap, such as ``tv_usec``."""
_HOUR_S: Final = 3600.0
_CLOCKS_S: Final = (_HOUR_S, 12 * _HOUR_S, 24 * _HOUR_S)
"""Times at which clocks wrap; by an hour also where summer time ends."""
_HIGHEST_RATE_HZ: Final = 1e6
_FEW_ROWS = 16
PAUSE_S = 1.0
"""Assumed pause before a clock that restarted; the true length is unknown."""

ROW_NUMBER = "row {}, counted from 0"
"""Name of a row of an array in messages."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Channels (n, 3), orientation (n, 4), with their times (n,), in the units of frames.

    Channels of one rate share one array of times.
    """

    values: Mapping[Channel, FloatArray]
    times: Mapping[Channel, FloatArray]
    row_names: Mapping[Channel, Callable[[int], str]]
    """Functions that return the name of a row in messages."""
    sequence: FloatArray | None = None
    """Frame numbers of an exported session, else None."""
    notes: tuple[str, ...] = ()
    """Sentences for the user on how the columns were mapped."""
    told: frozenset[str] = frozenset()
    """Quantities whose unit is stated other than by a standard name of a column."""

    def check(self) -> None:
        """Check times and values.

        Raises
        ------
        InputError
            Times decrease or are too few, a value is not finite, or an orientation is no unit
            quaternion; the message names the row.
        """
        for channel, values in self.values.items():
            self._check_time(channel, self.times[channel])
            rows, axes = np.nonzero(~(np.abs(values) <= _LARGEST))
            if len(rows):
                value = values[rows[0], axes[0]]
                what = "empty or NaN" if np.isnan(value) else value
                raise InputError(
                    f"{channel}_{axes_of(channel)[axes[0]]} is {what} in "
                    f"{self.row_name(channel, rows[0])}, and {len(set(rows.tolist())) - 1} "
                    "more rows are no such numbers as frames hold; --blanks-as-gaps leaves out "
                    "what is empty"
                )
            if channel == "orientation":
                self._check_norms(np.linalg.norm(values, axis=1))

    def _check_norms(self, norms: FloatArray) -> None:
        rows = np.flatnonzero(np.abs(norms - 1.0) > LARGEST_OFF)
        if len(rows):
            raise InputError(
                f"orientation is {norms[rows[0]]:.3g} long in "
                f"{self.row_name('orientation', rows[0])}, and {len(rows) - 1} more rows are no "
                "unit quaternions"
            )

    def row_name(self, channel: Channel, row: int | np.integer[Any]) -> str:
        """Return the name of a channel's row in messages."""
        return self.row_names[channel](int(row))

    def without_blanks(self) -> "Samples":
        """Return the samples without those rows of a channel whose value or time is not finite."""
        whole = {
            channel: np.isfinite(values).all(axis=1) & np.isfinite(self.times[channel])
            for channel, values in self.values.items()
        }
        return self._with_rows({channel: np.flatnonzero(rows) for channel, rows in whole.items()})

    def without_repeats(self) -> "Samples":
        """Return the samples without rows that repeat the time and all values of the row before.

        If there is any row of an equal time and other values, rows came in batches: all are kept.
        """
        rows, notes = {c: np.arange(len(values)) for c, values in self.values.items()}, []
        for time_s in {id(each): each for each in self.times.values()}.values():
            channels = [channel for channel, each in self.times.items() if each is time_s]
            alike = np.flatnonzero(np.diff(time_s) == 0)
            steps = (self.values[c][alike + 1] - self.values[c][alike] for c in channels)
            if len(alike) and not any(map(np.any, steps)):
                rows |= {c: np.delete(rows[c], alike + 1) for c in channels}
                told = f"{len(alike)} rows were written twice and left out"
                notes.append(f"{', '.join(channels)}: {told}")
        if not notes:
            return self
        return replace(self._with_rows(rows), notes=(*self.notes, *notes))

    def _with_rows(self, rows: Mapping[Channel, IntArray]) -> "Samples":
        """Return the samples with some rows of each channel; times stay shared where they are."""
        shared: dict[tuple[int, bytes], FloatArray] = {}
        times, names = {}, {}
        for channel, kept in rows.items():
            time_s = self.times[channel]
            times[channel] = shared.setdefault((id(time_s), kept.tobytes()), time_s[kept])
            names[channel] = partial(name_of, self.row_names[channel], kept)
        values = {channel: self.values[channel][kept] for channel, kept in rows.items()}
        return replace(self, values=values, times=times, row_names=names)

    def _check_time(self, channel: Channel, time_s: FloatArray) -> None:
        if len(time_s) < 2:
            raise InputError(f"{channel} has {len(time_s)} rows, at least 2 are needed")
        bad = np.flatnonzero(~np.isfinite(time_s))
        if len(bad):
            raise InputError(
                f"the time of {channel} is {time_s[bad[0]]} in "
                f"{self.row_name(channel, bad[0])}; --blanks-as-gaps leaves out such rows"
            )
        falls = np.flatnonzero(np.diff(time_s) < 0)
        if len(falls):
            row = int(falls[0]) + 1
            raise InputError(
                f"the time of {channel} is {time_s[row]:.15g} s in "
                f"{self.row_name(channel, row)}, after {time_s[row - 1]:.15g} s; times must not "
                "fall (--rate HZ takes even rows without them)"
            )
        span_s = time_s[-1] - time_s[0]
        steps_s = np.diff(time_s)
        longest = int(np.argmax(steps_s))
        if span_s > _LONGEST_S and steps_s[longest] > span_s / 2:
            raise InputError(
                f"the time of {channel} jumps by {steps_s[longest]:.9g} s in "
                f"{self.row_name(channel, longest + 1)}, as of a clock that was set; import the "
                "parts by themselves, or say the rows a second (--rate HZ)"
            )
        if span_s > _LONGEST_S:
            raise InputError(
                f"the times of {channel} span {span_s:.3g} s, a session lasts 49 "
                "days at most; say their unit, as in --unit time=ms (or us, ns)"
            )
        typical_s = float(np.median(steps_s))
        if 0 < typical_s < 1 / _HIGHEST_RATE_HZ:
            raise InputError(
                f"{channel} has {1 / typical_s:.2g} rows a second; say the unit of "
                "its times, as in --unit time=d for dates of Excel and MATLAB"
            )


def name_of(name: Callable[[int], str], rows: IntArray | Sequence[int], place: int) -> str:
    """Return the name of the row whose number is at index `place` of `rows` (n,)."""
    return name(int(rows[place]))


def order_of(time_s: FloatArray, columns: Iterable[FloatArray]) -> IntArray | None:
    """Return the order of rows with falling times (n,), if they were written late or twice.

    Rows that repeat a time and all `columns` (n, ...) are left out. Late rows leave a jump behind
    that is gone in the order of time; it is not if a clock was set, wrapped or began anew. Times
    that never rise are those of rows with the newest first.
    """
    steps_s = np.diff(time_s)
    falls = np.count_nonzero(steps_s < 0)
    if not falls or len(time_s) < _FEW_ROWS or not np.isfinite(time_s).all():
        return None
    if falls == np.count_nonzero(steps_s):  # the newest row first
        return np.arange(len(time_s))[::-1]
    order = np.argsort(time_s, kind="stable")
    twice = np.diff(time_s[order]) == 0
    for column in columns:
        rows = column[order]
        alike = (rows[1:] == rows[:-1]) | (np.isnan(rows[1:]) & np.isnan(rows[:-1]))
        twice &= alike.reshape(len(twice), -1).all(axis=1)
    left_out = np.sort(order[1:][twice])
    order = order[np.r_[True, ~twice]]
    ordered_s = np.diff(time_s[order])
    jump_s = 1.5 * np.median(steps_s[steps_s > 0])
    gone = np.count_nonzero(steps_s > jump_s) - np.count_nonzero(ordered_s > jump_s)
    stretches = np.split(left_out, np.flatnonzero(np.diff(left_out) > 1) + 1)
    repeated = sum(len(stretch) > 1 for stretch in stretches)  # one row alone may be chance
    return order if (ordered_s > 0).all() and falls <= gone + repeated else None


def unfilled_rows(time_s: FloatArray, columns: Iterable[FloatArray]) -> int:
    """Return how many rows at the end hold zeros alone: arrays were made larger than they got."""
    used = np.flatnonzero(time_s != 0)
    begin = int(used[-1]) + 1 if len(used) else 0
    if not begin or time_s[begin - 1] < 0 or any(np.any(column[begin:]) for column in columns):
        return 0
    return len(time_s) - begin


def continued(
    time_s: FloatArray, count_s: float, *, of_day: bool = False
) -> tuple[FloatArray, list[str]]:
    """Continue times (n,) after a counter wrapped or restarted; return the times, and notes.

    One count is `count_s`. Other decreases, such as of a single time, are left as they are. Times
    `of_day` may also skip an hour, where summer time begins.
    """
    steps_s = np.diff(time_s)
    falls = np.flatnonzero(steps_s < 0)
    near_s = 2 * _FEW_ROWS * float(np.median(steps_s)) if len(steps_s) else 0.0
    added_s = np.zeros(len(time_s))
    notes: dict[str, None] = {}
    if of_day:
        skips = np.flatnonzero((steps_s >= _HOUR_S) & (steps_s <= _HOUR_S + near_s))
        added_s[skips + 1] = -_HOUR_S
        notes |= dict.fromkeys(["skips an hour, which was left out"] if len(skips) else [])
    if not len(falls) or len(falls) > len(time_s) / _FEW_ROWS:
        return time_s + np.cumsum(added_s), list(notes)
    finest_s = [_FIELD_S] if count_s < _FIELD_S else []
    wraps_s = sorted([*(count * count_s for count in _COUNTS), *finest_s, *_CLOCKS_S])
    for fall, following in zip(falls, [*falls[1:], len(time_s) - 1], strict=True):
        drop_s = -steps_s[fall]
        wrap_s = next((w for w in wraps_s if -1e-9 * w <= w - drop_s <= near_s), None)
        few = time_s[fall + 1 : following + 1][:_FEW_ROWS]
        if wrap_s is not None:
            added_s[fall + 1] = wrap_s
            notes["wraps, and was continued"] = None
        elif (
            len(few) == _FEW_ROWS
            and few[0] < few[-1] < time_s[fall]
            and steps_s[fall - 1] <= near_s
        ):
            added_s[fall + 1] = drop_s + PAUSE_S
            put = f"begins anew, which was put {PAUSE_S:g} s after what was before"
            notes[f"{put}; --episode 1 takes the first part, 2 the next"] = None
    return time_s + np.cumsum(added_s), list(notes)
