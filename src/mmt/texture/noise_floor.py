"""What the accelerometer measures where there is nothing to feel.

While the tool is in the air or at rest, what passes the high-pass is the sensor's own noise, and
now and then a knock or the robot's motion. The lower quartile of the power of short windows is
the noise to some tenths (25th percentile of 50 squares of white noise: 0.87 of its power), as long
as a quarter of the windows holds nothing else; it errs low rather than high.
"""

from collections import deque
from typing import Final

import numpy as np

from mmt.texture.aligned import AlignedBlock

WINDOW: Final = 50
"""Samples of a window, which is used whole or not at all."""

LEAST_WINDOWS: Final = 4
"""With fewer nothing is said."""

_KEPT: Final = 200
_IN_AIR_N: Final = 0.05
_AT_REST_MM_S: Final = 3.0
_QUARTILE: Final = 25.0


class NoiseFloor:
    """The noise of a stream, from the windows of its newest blocks."""

    def __init__(self) -> None:
        self._powers: deque[float] = deque(maxlen=_KEPT)

    def update(self, block: AlignedBlock) -> None:
        """Take a block of the stream."""
        count = len(block) // WINDOW
        if not count:
            return
        part = block[: count * WINDOW]
        power = np.square(part.vibration_m_s2).sum(axis=1).reshape(count, WINDOW).mean(axis=1)
        still = part.speed_mm_s.reshape(count, WINDOW).max(axis=1) < _AT_REST_MM_S
        still |= part.normal_force_n.reshape(count, WINDOW).max(axis=1) < _IN_AIR_N
        still &= part.valid.reshape(count, WINDOW).all(axis=1) & np.isfinite(power)
        self._powers.extend(power[still].tolist())

    @property
    def power(self) -> float:
        """The noise's power in (m/s2)^2, 0 as long as nothing is known."""
        if len(self._powers) < LEAST_WINDOWS:
            return 0.0
        return float(np.percentile(self._powers, _QUARTILE))
