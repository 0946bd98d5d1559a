"""The follower's arm as a hand expects it; the arm itself is in `mmt.testing.simulation.robot`."""

import math
from typing import Final

from mmt.devices.protocols import Vector
from mmt.scene import Simulated

TIP_MASS_KG: Final = 0.08
"""Moving mass felt at the tip of a small arm."""

START_MM: Final[Vector] = (0.0, 0.0, 5.0)
"""Where the tip waits above the surface until the first command."""

_THREE_POLES = math.sqrt(2.0 ** (1.0 / 3.0) - 1.0)
"""Bandwidth (-3 dB) of three equal real poles, over the pole."""


def pole_of(bandwidth_hz: float) -> float:
    """Return the pole (rad/s) of which three in a row are 3 dB down at a bandwidth."""
    return 2.0 * math.pi * bandwidth_hz / _THREE_POLES


def nominal_compliance_mm_n(settings: Simulated) -> float:
    """Return how far (mm) the command must go below the surface for each newton."""
    stiffness_n_m = TIP_MASS_KG * pole_of(settings.robot_bandwidth_hz) ** 2
    return 1000.0 / stiffness_n_m + 1.0 / settings.surface_stiffness_n_mm
