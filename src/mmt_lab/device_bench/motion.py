"""What the emulated devices measure: vectors that turn, so that a value tells its time."""

import math
import time
from typing import Final

from mmt.devices.protocols import Vector

PERIOD_NS: Final = 50_000_000
"""Of a turn. A value tells the time within it, whatever a filter takes of its length."""


class Motion:
    """A vector at rest, and from `begin` on one that turns about z on top of it.

    Parameters
    ----------
    size
        Of what turns.
    rest
        What is there before, and along z.
    """

    def __init__(self, size: float, rest: Vector = (0.0, 0.0, 0.0)) -> None:
        self._size = size
        self._rest = rest
        self._begun = False
        self.asked: list[tuple[int, int]] = []
        """What was asked for since `begin`, and when (ns): a device held up asks late."""

    def begin(self) -> None:
        """Turn from now on."""
        self._begun = True

    def __call__(self, time_ns: int) -> Vector:
        """Return the vector at a time of the monotonic clock."""
        x, y, z = self._rest
        if not self._begun:
            return self._rest
        self.asked.append((time_ns, time.monotonic_ns()))
        angle = time_ns % PERIOD_NS / PERIOD_NS * math.tau
        return (x + self._size * math.cos(angle), y + self._size * math.sin(angle), z)
