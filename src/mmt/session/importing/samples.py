"""The channels of a recording with their times, checked."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.frames import Channel

_LONGEST_S = 4_200_000.0
"""The longest session: as many frames as 32 bits number."""

_LARGEST = float(np.finfo(np.float32).max)
"""Frames are in single precision."""

ROW_NUMBER = "row {}, counted from 0"
"""Names a row of an array in messages."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Channels (n, 3) with their times (n,), in the units of frames.

    Channels of one rate share one array of times.
    """

    origin: str
    """The file, for errors."""
    values: Mapping[Channel, FloatArray]
    times: Mapping[Channel, FloatArray]
    sequence: FloatArray | None = None
    """Frame numbers where the file is an exported session."""
    row_name: Callable[[int], str] = ROW_NUMBER.format

    def check(self) -> None:
        """Check times and values.

        Raises
        ------
        InputError
            A time that falls, or a value that is not finite; the message names the row.
        """
        for channel, values in self.values.items():
            self._check_time(channel, self.times[channel])
            rows, axes = np.nonzero(~(np.abs(values) <= _LARGEST))
            if len(rows):
                value = values[rows[0], axes[0]]
                what = "empty or NaN" if np.isnan(value) else value
                raise InputError(
                    f"{self.origin}: {channel}_{'xyz'[axes[0]]} is {what} in "
                    f"{self.row_name(int(rows[0]))}, and {len(set(rows.tolist())) - 1} more rows "
                    "are no such numbers as frames hold; --blanks-as-gaps leaves out what is empty"
                )

    def without_blanks(self) -> "Samples":
        """Return the samples without rows in which a channel or its time is not finite."""
        values, times = {}, {}
        shared: dict[tuple[int, bytes], FloatArray] = {}
        for channel, vectors in self.values.items():
            time_s = self.times[channel]
            whole = np.isfinite(vectors).all(axis=1) & np.isfinite(time_s)
            values[channel] = vectors[whole]
            times[channel] = shared.setdefault((id(time_s), whole.tobytes()), time_s[whole])
        return Samples(self.origin, values, times, self.sequence, self.row_name)

    def _check_time(self, channel: Channel, time_s: FloatArray) -> None:
        if len(time_s) < 2:
            raise InputError(
                f"{self.origin}: {channel} has {len(time_s)} rows, at least 2 are needed"
            )
        bad = np.flatnonzero(~np.isfinite(time_s))
        if len(bad):
            raise InputError(
                f"{self.origin}: the time of {channel} is {time_s[bad[0]]} in "
                f"{self.row_name(int(bad[0]))}"
            )
        falls = np.flatnonzero(np.diff(time_s) < 0)
        if len(falls):
            row = int(falls[0]) + 1
            raise InputError(
                f"{self.origin}: the time of {channel} is {time_s[row]:.9g} s in "
                f"{self.row_name(row)}, after {time_s[row - 1]:.9g} s; times must not fall"
            )
        span_s = time_s[-1] - time_s[0]
        if span_s > _LONGEST_S:
            raise InputError(
                f"{self.origin}: the times of {channel} span {span_s:.3g} s, a session lasts 49 "
                "days at most; say their unit, as in --unit time=ms (or us, ns)"
            )
