"""Checks of what a device reports: readings that are none, stuck values, implausible positions."""

import logging
import math
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Final, TypeVar

from mmt.core.arrays import Vector
from mmt.core.frames import LARGEST_QUANTITY

LOG: Final = logging.getLogger("mmt.devices")

QUIET_S: Final = 10.0
"""Time between two warnings while a fault goes on or comes back."""


def measured(value: Vector) -> Vector | None:
    """Return a reading, or None if it is not finite or larger than what a leader accepts."""
    x, y, z = value
    return (x, y, z) if math.hypot(x, y, z) <= LARGEST_QUANTITY else None


Value = TypeVar("Value")


def gathered(
    take: Callable[[], Iterable[Value]], least: int, shortest_s: float, longest_s: float
) -> list[Value]:
    """Return what `take` gives over `shortest_s`, and for longer while it is less than `least`.

    The result of the first call, which may be older, is left out.
    """
    list(take())
    values: list[Value] = []
    begun_s = time.monotonic()
    while (passed_s := time.monotonic() - begun_s) < shortest_s or (
        len(values) < least and passed_s < longest_s
    ):
        values += take()
        time.sleep(0.001)
    return values


class StuckCheck:
    """Detect a sensor that repeats one value for longer than a working one can.

    It stays stuck, also after it is connected again, until its value changes.

    Parameters
    ----------
    longest_ns
        Time after which a value that stays exactly the same is stuck; 0 for never.
    """

    def __init__(self, longest_ns: float) -> None:
        self.is_stuck = False
        self._longest_ns = longest_ns
        self._last: tuple[float, ...] | None = None
        self._since_ns = 0.0

    def add(self, value: tuple[float, ...], time_ns: float) -> bool:
        """Add a value and its time; return whether the sensor is stuck."""
        if value != self._last:
            self._last, self._since_ns, self.is_stuck = value, time_ns, False
        elif time_ns < self._since_ns:  # its clock restarted
            self._since_ns = time_ns
        elif 0 < self._longest_ns <= time_ns - self._since_ns:
            self.is_stuck = True
        return self.is_stuck

    def recovers(self, values: Iterable[tuple[float, ...]]) -> bool:
        """Return whether a sensor that was connected again gives a value, and a new one if stuck.

        The check then begins anew.
        """
        recovered = any(not self.is_stuck or value != self._last for value in values)
        if recovered:
            self.is_stuck, self._last = False, None
        return recovered


FASTEST_MM_S: Final = 5000.0
"""No hand and no arm of this kind moves its tip faster."""

_FARTHEST_MM: Final = 2000.0
"""No arm of this kind reaches farther."""
_LEAST_NS: Final = 1_000_000
"""A tick; in a shorter time, a tip may still have moved for a whole tick."""
_SLACK_NS: Final = 5_000_000
"""Longest time of motion that is granted to a tip during implausible measurements."""

NOT_FINITE: Final = "positions that are no numbers"
OUT_OF_REACH: Final = "positions out of reach"
JUMP: Final = "positions that jump"


class PlausibilityCheck:
    """Judge one device's measurements, in the order in which they come.

    Attributes
    ----------
    position
        Newest plausible position (mm).
    """

    def __init__(self) -> None:
        self.position: Vector | None = None
        self._good_ns = self._newest_ns = 0

    def problem(
        self, position: Sequence[float], velocity: Sequence[float], now_ns: int
    ) -> str | None:
        """Return what is implausible about a measurement, or None.

        Parameters
        ----------
        position, velocity
            Measured position (mm) and velocity (mm/s).
        now_ns
            Time of the measurement.
        """
        passed_ns, self._newest_ns = now_ns - self._newest_ns, now_ns
        x, y, z = position
        if not math.isfinite(math.hypot(x, y, z, *velocity)):
            return NOT_FINITE
        far = _FARTHEST_MM
        if not (-far <= x <= far and -far <= y <= far and -far <= z <= far):
            return OUT_OF_REACH
        if self.position is not None:
            moved_ns = min(now_ns - self._good_ns, passed_ns + _SLACK_NS)
            reach_mm = FASTEST_MM_S * 1e-9 * max(moved_ns, _LEAST_NS)
            if math.dist(self.position, position) > reach_mm:
                return JUMP
        self.position = (x, y, z)
        self._good_ns = now_ns
        return None
