"""The recording of another program: its samples, checked, and their frames at 1 kHz."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.frames import FIELD_OF_CHANNEL, Channel

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
