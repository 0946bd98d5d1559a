"""The recording of another program: its samples, checked, and their frames at 1 kHz."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL, Channel, frame_dtype
from mmt.session.data import FRAME_PERIOD_NS

_GRID_TOLERANCE = 0.2
"""Periods by which a time may lie off the 1 kHz grid and still be on it."""
_RATE_TOLERANCE = 0.01
_LONGEST_S = 4_200_000.0
"""The longest session: as many frames as 32 bits number."""

ROW_NUMBER = "row {}, counted from 0"
"""Names a row of an array in messages."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Channels (n, 3) with their times (n,), as they stand in a file.

    Acceleration may have times, and so a rate, of its own.
    """

    origin: str
    """The file, for errors."""
    time_s: FloatArray
    values: Mapping[Channel, FloatArray]
    acceleration_time_s: FloatArray | None = None
    sequence: FloatArray | None = None
    """Frame numbers where the file is an exported session."""
    row_name: Callable[[int], str] = ROW_NUMBER.format

    def check(self) -> None:
        """Check shapes, times and values.

        Raises
        ------
        InputError
            No channel, arrays that differ in length, a time that does not increase, a value
            that is not finite; the message names the column and the row.
        """
        if not self.values:
            names = ", ".join(FIELD_OF_CHANNEL.values())
            raise InputError(f"{self.origin}: holds none of {names}")
        self._check_time("time_s", self.time_s)
        if self.acceleration_time_s is not None:
            self._check_time("acceleration_time_s", self.acceleration_time_s)
        for channel, values in self.values.items():
            name, time_s = FIELD_OF_CHANNEL[channel], self.time_of(channel)
            if len(values) != len(time_s):
                raise InputError(
                    f"{self.origin}: {name} has {len(values)} rows, its times {len(time_s)}"
                )
            rows, columns = np.nonzero(~np.isfinite(values))
            if len(rows):
                value = values[rows[0], columns[0]]
                raise InputError(
                    f"{self.origin}: {name} {'xyz'[columns[0]]} is {value} in "
                    f"{self.row_name(int(rows[0]))}; every value must be a finite number"
                )

    def time_of(self, channel: Channel) -> FloatArray:
        """Return the times (n,) of a channel's rows."""
        if channel == "acceleration" and self.acceleration_time_s is not None:
            return self.acceleration_time_s
        return self.time_s

    def _check_time(self, name: str, time_s: FloatArray) -> None:
        if len(time_s) < 2:
            raise InputError(f"{self.origin}: {name} has {len(time_s)} rows, at least 2 are needed")
        bad = np.flatnonzero(~np.isfinite(time_s))
        if len(bad):
            raise InputError(
                f"{self.origin}: {name} is {time_s[bad[0]]} in {self.row_name(int(bad[0]))}"
            )
        falls = np.flatnonzero(np.diff(time_s) <= 0)
        if len(falls):
            row = int(falls[0]) + 1
            raise InputError(
                f"{self.origin}: {name} is {time_s[row]:.9g} in {self.row_name(row)}, after "
                f"{time_s[row - 1]:.9g}; times must increase from row to row"
            )
        span_s = time_s[-1] - time_s[0]
        if span_s > _LONGEST_S:
            raise InputError(
                f"{self.origin}: {name} spans {span_s:.3g} s, a session lasts 49 days at most; "
                "are the times in seconds?"
            )


def to_frames(samples: Samples, longest_gap_s: float | None = None) -> RecordArray:
    """Return samples as frames (n,) at 1 kHz, resampled only where they need it.

    Rows on a 1 kHz grid, within a fifth of a period, become frames as they are; so do
    those of an exported session, which have their frame numbers. Everything else goes
    through `mmt.session.resampling`, which imports scipy.

    Raises
    ------
    InputError
        The samples are not valid, or too few or too far apart to give a frame.
    """
    samples.check()
    numbers = None if samples.acceleration_time_s is not None else _frame_numbers(samples)
    if numbers is not None:
        time_ns = np.rint((samples.time_s - samples.time_s[0]) * 1e9).astype(np.int64)
        return _frames(samples, numbers, time_ns, samples.values)
    from mmt.session.resampling import resample

    numbers, values = resample(samples, longest_gap_s)
    return _frames(samples, numbers, numbers * FRAME_PERIOD_NS, values)


def _frame_numbers(samples: Samples) -> IntArray | None:
    """Return the frame number of each row, None where the rows are not frames."""
    periods = (samples.time_s - samples.time_s[0]) * 1000.0
    if samples.sequence is not None and len(samples.sequence) == len(periods):
        numbers = np.rint(samples.sequence)
        span = numbers[-1] - numbers[0]
        in_range = numbers[0] >= 0 and numbers[-1] < 2**32
        at_the_rate = abs(span - periods[-1]) <= max(1.0, _RATE_TOLERANCE * span)
        if in_range and at_the_rate and bool(np.all(np.diff(numbers) > 0)):
            return np.asarray(numbers, dtype=np.int64)
    numbers = np.rint(periods)
    steps = np.diff(numbers)
    on_the_grid = np.abs(periods - numbers).max() <= _GRID_TOLERANCE
    if on_the_grid and steps.min() > 0 and np.median(steps) == 1:
        return np.asarray(numbers, dtype=np.int64)
    return None


def _frames(
    samples: Samples,
    numbers: IntArray,
    time_ns: IntArray,
    values: Mapping[Channel, FloatArray],
) -> RecordArray:
    if len(numbers) == 0:
        raise InputError(
            f"{samples.origin}: no frame can be made: its channels share no time in which "
            "their samples are close enough together; are the times in seconds? Otherwise allow "
            "a longer gap"
        )
    channels = [channel for channel in CHANNELS if channel in values]
    frames = np.zeros(len(numbers), dtype=frame_dtype(channels))
    frames["sequence"] = numbers
    frames["time_ns"] = time_ns
    for channel in channels:
        frames[FIELD_OF_CHANNEL[channel]] = values[channel]
    return frames
