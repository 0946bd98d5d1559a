"""Devices that need no hardware: a hand, a robot on a known texture, sensors, an actuator.

Plain Python and NumPy: a simulated follower starts at once and stays small. Here is what they
share: their rate, noise, and the follower's arm as a hand expects it.
"""

import math
from typing import Final

import numpy as np

from mmt.core.arrays import Vector
from mmt.scene import Simulated

RATE_HZ: Final = 1000.0
"""Every simulated device ticks at the frame's rate."""

PERIOD_S: Final = 1.0 / RATE_HZ

PERIOD_NS: Final = 1_000_000

TIP_MASS_KG: Final = 0.08
"""Moving mass felt at the tip of a small arm."""

START_MM: Final[Vector] = (0.0, 0.0, 5.0)
"""Where the tip waits above the surface until the first command."""

_THREE_POLES: Final = math.sqrt(2.0 ** (1.0 / 3.0) - 1.0)
"""Bandwidth (-3 dB) of three equal real poles, over the pole."""

_BLOCK_ROWS: Final = 256


def pole_of(bandwidth_hz: float) -> float:
    """Return the pole (rad/s) of which three in a row are 3 dB down at a bandwidth."""
    return 2.0 * math.pi * bandwidth_hz / _THREE_POLES


def nominal_compliance_mm_n(settings: Simulated) -> float:
    """Return how far (mm) the command must go below the surface for each newton."""
    stiffness_n_m = TIP_MASS_KG * pole_of(settings.robot_bandwidth_hz) ** 2
    return 1000.0 / stiffness_n_m + 1.0 / settings.surface_stiffness_n_mm


class NoiseRows:
    """Rows of independent standard normal numbers for per-tick code, drawn in blocks.

    Numbers drawn together cost 20 ns each, single ones 1 us. The rows do not depend on how many
    are taken at a time.
    """

    def __init__(self, generator: np.random.Generator, width: int) -> None:
        self._generator = generator
        self._shape = (_BLOCK_ROWS, width)
        self._rows: list[list[float]] = []

    def next(self) -> list[float]:
        """Return the next row, `width` numbers."""
        if not self._rows:
            self._rows = self._generator.standard_normal(self._shape).tolist()
            self._rows.reverse()
        return self._rows.pop()
