"""Position, velocity and force from a pointer's reports; it has no clock of its own.

Screens report a pointer some 60 to 120 times a second. The velocity is that between the last two
reports, smoothed; it is held until the next one is overdue, and then decays: a pointer at rest
sends no reports.
"""

import math
from collections.abc import Iterable
from typing import Final

Point = tuple[float, float, float, float]
"""Time (ms), position x and y (mm), force (N)."""

_SMOOTHING_MS: Final = 12.0
_SHORTEST_INTERVAL_MS: Final = 0.01
_HELD_INTERVALS: Final = 2.0
_SHORTEST_HOLD_MS, _LONGEST_HOLD_MS = 20.0, 50.0
FASTEST_MM_S: Final = 5000.0
"""Faster than any hand: a pointer that exceeds it has jumped."""


class PointerMotion:
    """The motion of one pointer from touch-down to lift-off.

    Attributes
    ----------
    position_mm
        Newest report, x to the right and y upwards.
    velocity_mm_s
        Smoothed, along x and y.
    force_n
        Smoothed; 0 while it is lifted.
    touches
        Whether it is down.
    """

    def __init__(self) -> None:
        self.position_mm = (0.0, 0.0)
        self.velocity_mm_s = (0.0, 0.0)
        self.force_n = 0.0
        self.touches = False
        self._reported_ms = 0.0
        self._now_ms = 0.0
        self._hold_ms = _LONGEST_HOLD_MS

    def lift(self) -> None:
        """Lift the pointer: velocity and force become zero."""
        self.velocity_mm_s = (0.0, 0.0)
        self.force_n = 0.0
        self.touches = False

    def follow(self, points: Iterable[Point], now_ms: float) -> None:
        """Add the pointer's reports since the last call, in the order of time.

        Parameters
        ----------
        points
            Reports; one that is no later than the one before it is left out.
        now_ms
            The time now, by the same clock.
        """
        for point in points:
            self._add(point)
        overdue_ms = now_ms - max(self._now_ms, self._reported_ms + self._hold_ms)
        if overdue_ms > 0.0:
            left = math.exp(-overdue_ms / _SMOOTHING_MS)
            self.velocity_mm_s = (self.velocity_mm_s[0] * left, self.velocity_mm_s[1] * left)
        self._now_ms = max(now_ms, self._now_ms)

    def _add(self, point: Point) -> None:
        time_ms, x_mm, y_mm, force_n = point
        if not self.touches:
            self.touches = True
            self.force_n = force_n
            self._hold_ms = _LONGEST_HOLD_MS
        else:
            passed_ms = time_ms - self._reported_ms
            if passed_ms < _SHORTEST_INTERVAL_MS:
                return
            share = -math.expm1(-passed_ms / _SMOOTHING_MS)
            there = ((x_mm - self.position_mm[0]), (y_mm - self.position_mm[1]))
            fast = 1e3 * math.hypot(*there) / passed_ms
            within = 1e3 / passed_ms * min(1.0, FASTEST_MM_S / fast if fast else 1.0)
            self.velocity_mm_s = (
                self.velocity_mm_s[0] + share * (within * there[0] - self.velocity_mm_s[0]),
                self.velocity_mm_s[1] + share * (within * there[1] - self.velocity_mm_s[1]),
            )
            self.force_n += share * (force_n - self.force_n)
            self._hold_ms = min(
                max(_HELD_INTERVALS * passed_ms, _SHORTEST_HOLD_MS), _LONGEST_HOLD_MS
            )
        self.position_mm = (x_mm, y_mm)
        self._reported_ms = time_ms
