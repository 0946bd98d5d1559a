"""Whether a tip can be where a device says that it is."""

import math
from collections.abc import Sequence
from typing import Final

from mmt.devices.protocols import Vector

FASTEST_MM_S: Final = 5000.0
"""No hand and no arm of this kind moves its tip faster."""

_FARTHEST_MM: Final = 2000.0
"""Nor does any reach so far."""
_LEAST_NS: Final = 1_000_000
"""A tick; in less, a tip may still have moved for a whole one."""
_LEAST_MM2: Final = (FASTEST_MM_S * 1e-9 * _LEAST_NS) ** 2
_SLACK_NS: Final = 5_000_000
"""For this long a tip may have moved on during measurements that make no sense."""

NOT_FINITE: Final = "positions that are no numbers"
OUT_OF_REACH: Final = "positions out of reach"
JUMP: Final = "positions that jump"


class Watch:
    """Judge one device's measurements, in the order in which they come.

    Attributes
    ----------
    position
        The newest one that makes sense.
    """

    def __init__(self) -> None:
        self.position: Vector | None = None
        self._good_ns = self._newest_ns = 0

    def problem(
        self, position: Sequence[float], velocity: Sequence[float], now_ns: int
    ) -> str | None:
        """Return what makes no sense of a measurement, None where it is believed.

        Parameters
        ----------
        position, velocity
            mm and mm/s.
        now_ns
            When they were measured.
        """
        passed_ns, self._newest_ns = now_ns - self._newest_ns, now_ns
        x, y, z = position
        u, v, w = velocity
        if not math.isfinite(x + y + z + u + v + w):
            return NOT_FINITE
        far = _FARTHEST_MM
        if not (-far <= x <= far and -far <= y <= far and -far <= z <= far):
            return OUT_OF_REACH
        if self.position is not None:
            a, b, c = self.position
            moved_mm2 = (x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2
            if moved_mm2 > _LEAST_MM2:  # else it could in any case
                moved_ns = min(now_ns - self._good_ns, passed_ns + _SLACK_NS)
                reach_mm = FASTEST_MM_S * 1e-9 * max(moved_ns, _LEAST_NS)
                if moved_mm2 > reach_mm * reach_mm:
                    return JUMP
        self.position = (x, y, z)
        self._good_ns = now_ns
        return None
