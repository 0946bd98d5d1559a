"""Transient of a surface's touch-downs: learnt shapes, and amplitude over the speed."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.touch_down import LEAST_RATE_HZ, WINDOW_S

MOST_SHAPES: Final = 4
STEEPEST: Final = 1.5
"""Largest exponent of the amplitude over the approach speed."""
_LARGEST: Final = 1e6
_LONGEST: Final = round(WINDOW_S * 1e6)  # samples at the largest rate, `core.bounds.RateHz`
_REFERENCE_MM_S: Final = 100.0


@dataclass(frozen=True)
class Law:
    """Amplitude as a power law of the approach speed; proportional to it below the slowest.

    ``amplitude`` is the root of the energy at 100 mm/s, in m/s2 times the root of a second.
    ``slowest_mm_s`` and ``fastest_mm_s`` bound the learnt speeds; faster ones count as the fastest.
    ``error_db`` is the standard deviation of the energy about the law.
    """

    amplitude: float
    exponent: float
    slowest_mm_s: float
    fastest_mm_s: float
    error_db: float

    def at(self, speed_mm_s: float) -> float:
        """Return the root of the energy at an approach speed, 0 unless it is positive."""
        if not speed_mm_s > 0.0:
            return 0.0
        known = min(max(speed_mm_s, self.slowest_mm_s), self.fastest_mm_s)
        below = min(speed_mm_s / self.slowest_mm_s, 1.0)
        return below * self.amplitude * float((known / _REFERENCE_MM_S) ** self.exponent)


@dataclass(frozen=True, eq=False)
class Transient:
    """The transients of a surface, each for the approach speeds around its own.

    Attributes
    ----------
    speeds_mm_s : (g,)
        Approach speeds of the shapes, ascending.
    shapes : (g, n)
        Recorded transients, scaled to an energy (sum of squares over the rate) of 1.
    law
        Their amplitude over the approach speed.
    """

    speeds_mm_s: FloatArray
    shapes: FloatArray
    law: Law

    def response(self, speed_mm_s: float) -> FloatArray:
        """Return the acceleration (n,) in m/s2 of a touch-down at an approach speed."""
        amplitude = self.law.at(speed_mm_s)
        if amplitude == 0.0:
            return np.zeros(self.shapes.shape[1])
        away = np.abs(np.log(self.speeds_mm_s) - np.log(speed_mm_s))
        return np.asarray(amplitude * self.shapes[np.argmin(away)])

    def at_rate(self, before_hz: float, rate_hz: float) -> "Transient | None":
        """Return the transient at another rate, band-limited; None below `LEAST_RATE_HZ`."""
        if rate_hz < LEAST_RATE_HZ:
            return None
        count = self.shapes.shape[1]
        resized = max(1, round(count * rate_hz / before_hz))
        spectra = np.fft.rfft(self.shapes, axis=1)
        if resized > count and count % 2 == 0:
            spectra[:, -1] *= 0.5  # half the old rate is one frequency there, and two here
        shapes = np.fft.irfft(spectra, resized, axis=1) * (resized / count)
        return Transient(self.speeds_mm_s, shapes, self.law)

    def check(self) -> None:
        """Check values that were read from a file.

        Raises
        ------
        InputError
            Shapes disagree, or a number is not in its range.
        """
        law, speeds = self.law, self.speeds_mm_s
        if self.shapes.ndim != 2 or speeds.shape != self.shapes.shape[:1]:
            raise InputError(
                f"touch_down_speed_mm_s has shape {speeds.shape} and touch_down_shapes "
                f"{self.shapes.shape}: (g,) and (g, n) are needed"
            )
        count, length = self.shapes.shape
        if not (1 <= count <= MOST_SHAPES and 1 <= length <= _LONGEST):
            raise InputError(
                f"touch_down_shapes has shape {self.shapes.shape}: at most {MOST_SHAPES} of "
                f"{_LONGEST} samples are allowed, and at least one of one"
            )
        good = bool((np.abs(self.shapes) <= _LARGEST).all() and (np.diff(speeds) >= 0.0).all())
        good = good and bool(speeds[0] > 0.0 and speeds[-1] <= _LARGEST)
        good = good and 0.0 <= law.amplitude <= _LARGEST and 0.0 <= law.exponent <= STEEPEST
        good = good and 0.0 < law.slowest_mm_s <= law.fastest_mm_s <= _LARGEST
        if not (good and 0.0 <= law.error_db <= _LARGEST):
            raise InputError(
                "touch_down_shapes, touch_down_speed_mm_s or touch_down_law holds a number that "
                "is out of its range"
            )
