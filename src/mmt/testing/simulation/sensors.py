"""What the follower's sensors make of the truth: noise, resolution, range.

Figures: ATI Nano17 SI-12-0.12 (12 N across, 17 N along its axis, resolution 1/320 N);
ADXL335 data sheet (150 ug/sqrt(Hz) on X and Y at 3 V, 3.6 g typical range); a position
resolution of 0.03 mm as of a Phantom Premium.
"""

from math import cos, floor, pi, sin, sqrt
from typing import Final

import numpy as np

from mmt.devices.protocols import Vector
from mmt.testing.simulation import PERIOD_S, RATE_HZ
from mmt.testing.simulation.noise import NoiseRows

GRAVITY_M_S2: Final = 9.80665

ENCODER_RESOLUTION_MM: Final = 0.03

FORCE_RESOLUTION_N: Final = 1.0 / 320.0
FORCE_NOISE_N: Final = 0.003
"""Root mean square, about one step of the sensor's resolution."""
FORCE_RANGE_N: Final[Vector] = (12.0, 12.0, 17.0)

ACCELERATION_NOISE_M_S2: Final = 150e-6 * GRAVITY_M_S2 * sqrt(0.5 * RATE_HZ)
"""Root mean square of white noise over the band up to half the rate: 0.033 m/s2."""
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
    """A six-axis force sensor behind the tip, its three forces; saturates at its range."""

    def __init__(self, generator: np.random.Generator, *, exact: bool) -> None:
        self._noise = NoiseRows(generator, 3)
        self._exact = exact

    def measure(self, force_n: Vector) -> Vector:
        """Return the force (N) as the sensor gives it."""
        if self._exact:
            return force_n
        noise = self._noise.next()
        x, y, z = (
            _limited(quantise(force + FORCE_NOISE_N * error, FORCE_RESOLUTION_N), limit)
            for force, error, limit in zip(force_n, noise, FORCE_RANGE_N, strict=True)
        )
        return x, y, z


class TiltedAccelerometer:
    """An accelerometer on a tool that leans a little and never quite the same way.

    It measures proper acceleration: at rest, 9.81 m/s2 upwards, shared between the axes
    by the lean of up to `TILT_RAD` about x and y, which wanders over some ten seconds.
    The lean acts on gravity alone; on the vibration it would change the level by 0.2 %.
    Gravity and lean stay where noise and resolution are turned off. All axes are as quiet
    as the part's X and Y: a lab mounts it so that its noisier Z axis is not the normal.
    """

    def __init__(self, generator: np.random.Generator, *, exact: bool) -> None:
        self._phases = [float(phase) for phase in generator.uniform(0.0, 2.0 * pi, 2)]
        self._noise = NoiseRows(generator, 3)
        self._exact = exact
        self._tick = 0

    def measure(self, acceleration_m_s2: Vector) -> Vector:
        """Return the proper acceleration (m/s2) at the next tick."""
        time_s = self._tick * PERIOD_S
        self._tick += 1
        lean_x, lean_y = (
            TILT_RAD * sin(2.0 * pi * time_s / period + phase)
            for period, phase in zip(_TILT_PERIODS_S, self._phases, strict=True)
        )
        x, y, z = acceleration_m_s2
        x += GRAVITY_M_S2 * sin(lean_x)
        y += GRAVITY_M_S2 * sin(lean_y) * cos(lean_x)
        z += GRAVITY_M_S2 * cos(lean_x) * cos(lean_y)
        if self._exact:
            return x, y, z
        noise = self._noise.next()
        x, y, z = (_sampled(a, e) for a, e in zip((x, y, z), noise, strict=True))
        return x, y, z


def _sampled(acceleration: float, error: float) -> float:
    value = quantise(acceleration + ACCELERATION_NOISE_M_S2 * error, ACCELERATION_RESOLUTION_M_S2)
    return _limited(value, ACCELERATION_RANGE_M_S2)


def _limited(value: float, limit: float) -> float:
    return -limit if value < -limit else min(value, limit)
