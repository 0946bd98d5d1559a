"""Make frames from the tip's true motion: add the surface's texture, then apply the sensors."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.frames import frame_dtype, frame_struct, ordered_channels
from mmt.devices.protocols import Vector
from mmt.testing.simulation import PERIOD_NS, RATE_HZ
from mmt.testing.simulation.course import CourseVibration, SurfaceCourse
from mmt.testing.simulation.known_surfaces import KnownSurface
from mmt.testing.simulation.robot import TipState
from mmt.testing.simulation.sensors import Encoder, ForceGauge, TiltedAccelerometer
from mmt.testing.simulation.vibration import vibration_of
from mmt.testing.simulation.vibration_source import VibrationSource

LEAST_SPEED_MM_S: Final = 1.0
"""Below this a heading is not defined; the last one holds."""


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
        surface: KnownSurface | SurfaceCourse,
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
        self._vibration: VibrationSource = (
            CourseVibration(surface, texture)
            if isinstance(surface, SurfaceCourse)
            else vibration_of(surface, texture)
        )
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
        if isinstance(self._vibration, CourseVibration):
            return self._vibration.surface.friction_coefficient
        return None

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
        speed = math.hypot(u, v)
        if speed > LEAST_SPEED_MM_S:
            self._heading = (u / speed, v / speed)
        made = self._vibration.run(
            self._samples, speed, tip.force_n[2], self._heading, tip.position_mm[:2]
        )
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
