"""Noise floor of the accelerometer, estimated while nothing is touched.

While the tool is in the air or at rest, the signal behind the high-pass is the sensor's own noise,
and now and then a knock or the robot's motion. The lower quartile of the power of short windows is
the noise to some tenths (25th percentile of 50 squares of white noise: 0.87 of its power), as long
as a quarter of the windows holds nothing else. It is too low rather than too high.
"""

import statistics
from collections import deque
from typing import Final

import numpy as np

from mmt.texture.signals.aligned import AlignedBlock

WINDOW: Final = 50
"""Frames of a window, which is used whole or not at all."""

LEAST_WINDOWS: Final = 4
"""Least windows from which the noise is estimated."""

WINDOWS_KEPT: Final = 200
"""Number of newest windows from which the noise is estimated."""

_IN_AIR_N: Final = 0.05
_AT_REST_MM_S: Final = 3.0


class NoiseFloor:
    """Noise power of a stream, from its newest windows without contact or motion."""

    def __init__(self) -> None:
        self._powers: deque[float] = deque(maxlen=WINDOWS_KEPT)

    def update(self, block: AlignedBlock) -> None:
        """Add a block of the stream."""
        count = len(block) // WINDOW
        if not count:
            return
        part = block[: count * WINDOW]
        power = np.square(part.vibration_m_s2).sum(axis=2).reshape(count, -1).mean(axis=1)
        still = part.normal_force_n.reshape(count, WINDOW).max(axis=1) < _IN_AIR_N
        still |= part.speed_mm_s.reshape(count, WINDOW).max(axis=1) < _AT_REST_MM_S
        still &= part.valid.reshape(count, WINDOW).all(axis=1) & np.isfinite(power)
        self._powers.extend(power[still].tolist())

    @property
    def power(self) -> float:
        """Noise power in (m/s2)^2, 0 with fewer than `LEAST_WINDOWS` windows."""
        if len(self._powers) < LEAST_WINDOWS:
            return 0.0
        return statistics.quantiles(self._powers, n=4, method="inclusive")[0]
