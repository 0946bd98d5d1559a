"""The follower's sensors: noise, resolution and range, added to the truth.

Figures: ATI Nano17 SI-12-0.12 (12 N across, 17 N along its axis, resolution 1/320 N);
ADXL335 data sheet (150 ug/sqrt(Hz) on X and Y at 3 V, 3.6 g typical range); a position
resolution of 0.03 mm as of a Phantom Premium.
"""

from math import cos, floor, pi, sin, sqrt
from typing import Final

import numpy as np

from mmt.devices.protocols import Vector
from mmt.testing.simulation import RATE_HZ
from mmt.testing.simulation.noise import NoiseRows

GRAVITY_M_S2: Final = 9.80665

ENCODER_RESOLUTION_MM: Final = 0.03

FORCE_RESOLUTION_N: Final = 1.0 / 320.0
FORCE_NOISE_N: Final = 0.003
"""Root mean square, about one step of the sensor's resolution."""
FORCE_RANGE_N: Final[Vector] = (12.0, 12.0, 17.0)

ACCELERATION_NOISE_M_S2: Final = 150e-6 * GRAVITY_M_S2 * sqrt(0.5 * RATE_HZ)
"""Root mean square of white noise over the band up to half of 1 kHz: 0.033 m/s2."""
ACCELERATION_RANGE_M_S2: Final = 3.6 * GRAVITY_M_S2
ACCELERATION_RESOLUTION_M_S2: Final = 2.0 * ACCELERATION_RANGE_M_S2 / 4096.0
"""Twelve bits over both signs."""

TILT_RAD: Final = 0.06
_TILT_PERIODS_S: Final = (7.0, 11.0)


def quantise(value: float, resolution: float) -> float:
    """Return the nearest multiple of the resolution."""
    return floor(value / resolution + 0.5) * resolution


class Encoder:
    """Position from the arm's encoders."""

    def __init__(self, *, exact: bool) -> None:
        self._exact = exact

    def measure(self, position_mm: Vector) -> Vector:
        """Return the position (mm) in steps of the encoder."""
        if self._exact:
            return position_mm
        x, y, z = position_mm
        step = ENCODER_RESOLUTION_MM
        return quantise(x, step), quantise(y, step), quantise(z, step)


class ForceGauge:
    """The three forces of a six-axis sensor behind the tip; saturates at its range."""

    def __init__(self, generator: np.random.Generator, *, exact: bool) -> None:
        self._noise = NoiseRows(generator, 3)
        self._exact = exact

    def measure(self, force_n: Vector) -> Vector:
        """Return the force (N) as the sensor gives it."""
        if self._exact:
            return force_n
        x, y, z = force_n
        a, b, c = self._noise.next()
        range_x, range_y, range_z = FORCE_RANGE_N
        return (
            _reading(x + FORCE_NOISE_N * a, FORCE_RESOLUTION_N, range_x),
            _reading(y + FORCE_NOISE_N * b, FORCE_RESOLUTION_N, range_y),
            _reading(z + FORCE_NOISE_N * c, FORCE_RESOLUTION_N, range_z),
        )


class TiltedAccelerometer:
    """An accelerometer on a tool that leans by a small, slowly changing angle.

    It measures proper acceleration: at rest, 9.81 m/s2 upwards, shared between the axes
    by the lean of up to `TILT_RAD` about x and y, which varies over some ten seconds.
    The lean acts on gravity alone; on the vibration it would change the level by 0.2 %.
    Gravity and lean stay if noise and resolution are turned off. All axes are as quiet as the
    part's X and Y: a lab mounts the sensor so that its noisier Z axis is not the normal. The noise
    has the same density at every rate.
    """

    def __init__(
        self, generator: np.random.Generator, *, exact: bool, rate_hz: float = RATE_HZ
    ) -> None:
        self._phase_x, self._phase_y = generator.uniform(0.0, 2.0 * pi, 2).tolist()
        self._noise = NoiseRows(generator, 3)
        self._exact = exact
        self._deviation = ACCELERATION_NOISE_M_S2 * sqrt(rate_hz / RATE_HZ)
        self._period_s = 1.0 / rate_hz
        self._sample = 0

    def measure(self, acceleration_m_s2: Vector) -> Vector:
        """Return the proper acceleration (m/s2) at the next sample."""
        time_s = self._sample * self._period_s
        self._sample += 1
        turns = 2.0 * pi * time_s
        lean_x = TILT_RAD * sin(turns / _TILT_PERIODS_S[0] + self._phase_x)
        lean_y = TILT_RAD * sin(turns / _TILT_PERIODS_S[1] + self._phase_y)
        upright = cos(lean_x)
        x, y, z = acceleration_m_s2
        x += GRAVITY_M_S2 * sin(lean_x)
        y += GRAVITY_M_S2 * sin(lean_y) * upright
        z += GRAVITY_M_S2 * upright * cos(lean_y)
        if self._exact:
            return x, y, z
        a, b, c = self._noise.next()
        step, limit = ACCELERATION_RESOLUTION_M_S2, ACCELERATION_RANGE_M_S2
        deviation = self._deviation
        return (
            _reading(x + deviation * a, step, limit),
            _reading(y + deviation * b, step, limit),
            _reading(z + deviation * c, step, limit),
        )


def _reading(value: float, resolution: float, limit: float) -> float:
    """Return the nearest step of a converter within its range; `quantise` inlined for speed."""
    value = floor(value / resolution + 0.5) * resolution
    if value > limit:
        return limit
    return value if value >= -limit else -limit
