"""The follower's sensors, and the frames that they make of the tip's true motion and texture.

The texture's vibration is added to the motion; each sensor then adds noise, resolution and range.
Figures: ATI Nano17 SI-12-0.12 (12 N across, 17 N along its axis, resolution 1/320 N);
ADXL335 data sheet (150 ug/sqrt(Hz) on X and Y at 3 V, 3.6 g typical range); a position
resolution of 0.03 mm as of a Phantom Premium.
"""

from collections.abc import Sequence
from math import cos, floor, hypot, pi, sin, sqrt
from typing import TYPE_CHECKING, Final

import numpy as np

from mmt.core.arrays import RecordArray, Vector
from mmt.core.frames import frame_dtype, frame_struct, ordered_channels
from mmt.testing.simulation import PERIOD_NS, RATE_HZ, NoiseRows
from mmt.testing.simulation.robot import TipState
from mmt.testing.simulation.surfaces.known_surfaces import KnownSurface, Stroke

if TYPE_CHECKING:
    from mmt.testing.simulation.surfaces.course import SurfaceCourse

GRAVITY_M_S2: Final = 9.80665  # as in `mmt.core.units`, which a simulated follower does not load

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

LEAST_SPEED_MM_S: Final = 1.0
"""Below this a heading is not defined; the last one holds."""


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


class Instruments:
    """The follower's sensors on a tool that strokes a known surface.

    Only what the channels need is computed. The random numbers of one sensor do not depend on
    the other sensors. A frame has as many samples of acceleration as the surface's rate gives in
    a tick; between two ticks the tip's own acceleration is interpolated linearly.

    Parameters
    ----------
    surface
        The texture under the tool, or a course over several.
    channels
        The channels of the frames.
    seed
        The scene's seed.
    noise
        False for sensors without noise, resolution and range.
    """

    def __init__(
        self,
        surface: "KnownSurface | SurfaceCourse",
        channels: Sequence[str],
        seed: int,
        *,
        noise: bool,
    ) -> None:
        texture, gauge, accelerometer = (
            np.random.default_rng(part) for part in np.random.SeedSequence([seed, 2]).spawn(3)
        )
        chosen = ordered_channels(channels)
        self._samples = round(surface.rate_hz / RATE_HZ)
        self.dtype = frame_dtype(chosen, self._samples)
        """Dtype of the frames."""
        self._shares = [1.0 - (at + 1) / self._samples for at in range(self._samples)]
        self._pack = frame_struct(self.dtype).pack
        self._with_position = "position" in chosen
        self._with_force = "force" in chosen
        self._with_acceleration = "acceleration" in chosen
        self._vibration = surface.vibration(texture)
        self._encoder = Encoder(exact=not noise)
        self._gauge = ForceGauge(gauge, exact=not noise)
        self._accelerometer = TiltedAccelerometer(
            accelerometer, exact=not noise, rate_hz=surface.rate_hz
        )
        self._moved: Vector | None = None
        self._heading = (1.0, 0.0)
        self._sequence = 0
        self.start_time_ns = 0
        """Time of the frame with sequence number 0."""

    @property
    def friction_coefficient(self) -> float | None:
        """Friction of the surface that a course has reached, or None without a course."""
        return self._vibration.friction_coefficient

    def frames(self, tips: Sequence[TipState]) -> RecordArray:
        """Return one frame for each tick's state, shape (n,)."""
        packed = bytearray().join(self._frame(tip) for tip in tips)
        return np.frombuffer(packed, self.dtype)

    def _frame(self, tip: TipState) -> bytes:
        values: list[float] = []
        if self._with_position:
            values += self._encoder.measure(tip.position_mm)
        if self._with_force:
            values += self._gauge.measure(tip.force_n)
        if self._with_acceleration:
            for sample in self._shaken(tip):
                values += self._accelerometer.measure(sample)
        time_ns = self.start_time_ns + self._sequence * PERIOD_NS
        self._sequence += 1
        return self._pack((self._sequence - 1) & 0xFFFFFFFF, time_ns, *values)

    def _shaken(self, tip: TipState) -> list[Vector]:
        """Return the tip's acceleration with the texture's vibration added, sample by sample."""
        u, v, _ = tip.velocity_mm_s
        speed = hypot(u, v)
        if speed > LEAST_SPEED_MM_S:
            self._heading = (u / speed, v / speed)
        stroke = Stroke(speed, tip.force_n[2], self._heading, tip.position_mm[:2])
        made = self._vibration.run(self._samples, stroke)
        u, v = self._heading
        x, y, z = tip.acceleration_m_s2
        before_x, before_y, before_z = self._moved or tip.acceleration_m_s2
        self._moved = tip.acceleration_m_s2
        shaken: list[Vector] = []
        for left, (normal, along) in zip(self._shares, made, strict=True):
            shaken.append(
                (
                    x + left * (before_x - x) + along * u,
                    y + left * (before_y - y) + along * v,
                    z + left * (before_z - z) + normal,
                )
            )
        return shaken
