"""The parts that a known texture is made of: how each follows speed and normal force.

Every part is one resonator driven by white noise of its own: a damped rotation, whose
spectrum is a Lorentzian peak. Textures differ in how the power, frequency and bandwidth of
their parts follow speed and force; a part with a `Grain` also follows the heading of the
stroke. The maps use arithmetic alone, so that the same code serves one tick (floats) and the
whole plane (arrays).
"""

from dataclasses import dataclass
from math import cos, radians, sin
from typing import Final, TypeVar

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError

Number = TypeVar("Number", float, FloatArray)

REFERENCE_SPEED_MM_S: Final = 100.0
"""Speed at which a part's `power` is given; the reference force is 1 N."""

TAPER_HZ: Final = 430.0
"""A line fades out from this frequency on, before 500 Hz, half the least sampling rate."""

HIGHEST_HZ: Final = 480.0


@dataclass(frozen=True, slots=True)
class Grain:
    """The direction of ridges, threads, fibres or pile that a part of the texture comes from.

    With v the speed of the stroke, c and s the cosine and sine of the angle from `across_deg`
    to its heading, the part's effective speed is ``v sqrt(c^2 + along^2 s^2)``, and it has
    ``1 + nap c`` times the power. A line of period p therefore has the frequency ``|v c| / p``
    (its wavelength along the stroke is ``p / |c|``), apart from the share `along` of the speed
    along the ridges. This share keeps the frequency smooth when the stroke turns into the
    ridges: a stroke along undulating ridges crosses them too.

    Parameters
    ----------
    across_deg
        The heading that crosses the ridges, counted from x to y; with a nap, the heading
        against it.
    along
        Share of the speed along the ridges that counts, above 0 to 1; 1 means no ridges.
    nap
        Power against the nap over its mean over all headings, less 1; above -1, below 1.

    Raises
    ------
    InputError
        A number is out of its range.
    """

    across_deg: float
    along: float
    nap: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 < self.along <= 1.0 and -1.0 < self.nap < 1.0):
            raise InputError(
                f"grain: along is {self.along} and nap {self.nap}, allowed are above 0 to 1 "
                "and above -1 to below 1"
            )

    def effective(self, speed_mm_s: Number, cosine: Number, sine: Number) -> tuple[Number, Number]:
        """Return the part's effective speed (mm/s), and the factor on its power.

        Parameters
        ----------
        speed_mm_s
            The stroke's speed.
        cosine, sine
            Components of the heading, the unit vector of the velocity.
        """
        across = radians(self.across_deg)
        c = cosine * cos(across) + sine * sin(across)
        s = self.along * (sine * cos(across) - cosine * sin(across))
        return speed_mm_s * (c * c + s * s) ** 0.5, 1.0 + self.nap * c


@dataclass(frozen=True, slots=True)
class Resonance:
    """A resonance of the tool or the surface, or a broad shelf if it is wide.

    With v in units of 100 mm/s, F in newton, ``rise(x, h) = x / (x + h)``:
    power ``power v^speed_exponent F^force_exponent`` (m/s2)^2; frequency
    ``frequency_hz + speed_shift_hz rise(v, 1.5) + force_shift_hz rise(F, 1)``; bandwidth
    ``bandwidth_hz (1 + force_damping rise(F, 1))``.
    """

    power: float
    speed_exponent: float
    force_exponent: float
    frequency_hz: float
    bandwidth_hz: float
    speed_shift_hz: float = 0.0
    force_shift_hz: float = 0.0
    force_damping: float = 0.0
    grain: Grain | None = None

    def maps(self, speed_mm_s: Number, force_n: Number) -> tuple[Number, Number, Number]:
        """Return power (m/s2)^2, frequency (Hz) and bandwidth (Hz) at speeds and forces."""
        speed = speed_mm_s / REFERENCE_SPEED_MM_S
        rise = force_n / (force_n + 1.0)
        power: Number = self.power * speed**self.speed_exponent * force_n**self.force_exponent
        frequency = self.frequency_hz + self.speed_shift_hz * speed / (speed + 1.5)
        frequency = frequency + self.force_shift_hz * rise
        return power, frequency, self.bandwidth_hz * (1.0 + self.force_damping * rise)


@dataclass(frozen=True, slots=True)
class Line:
    """A spectral line of a surface that repeats itself: its frequency is speed over period.

    The line's width is ``least_width_hz + relative_width`` times its frequency; its power
    follows the same law as a resonance's and fades towards 500 Hz.
    """

    power: float
    speed_exponent: float
    force_exponent: float
    period_mm: float
    relative_width: float
    least_width_hz: float = 3.0
    grain: Grain | None = None

    def maps(self, speed_mm_s: Number, force_n: Number) -> tuple[Number, Number, Number]:
        """Return power (m/s2)^2, frequency (Hz) and bandwidth (Hz) at speeds and forces."""
        line = speed_mm_s / self.period_mm
        speed = speed_mm_s / REFERENCE_SPEED_MM_S
        power: Number = self.power * speed**self.speed_exponent * force_n**self.force_exponent
        taper = 1.0 + (line / TAPER_HZ) ** 24
        frequency: Number = line / (1.0 + (line / HIGHEST_HZ) ** 16) ** 0.0625
        return power / taper, frequency, self.least_width_hz + self.relative_width * frequency


Mode = Resonance | Line


def maps_at(
    mode: Mode, speed_mm_s: Number, force_n: Number, cosine: Number, sine: Number
) -> tuple[Number, Number, Number]:
    """Return a part's power, frequency and bandwidth for strokes of a heading.

    Parameters
    ----------
    mode
        The part.
    speed_mm_s, force_n
        Speed and force of the stroke.
    cosine, sine
        Components of the unit vector of its heading; unused without a grain.
    """
    if mode.grain is None:
        return mode.maps(speed_mm_s, force_n)
    effective_mm_s, factor = mode.grain.effective(speed_mm_s, cosine, sine)
    power, frequency, bandwidth = mode.maps(effective_mm_s, force_n)
    return power * factor, frequency, bandwidth


def ridges(
    period_mm: float,
    powers: tuple[float, ...],
    width: float,
    grain: Grain | None = None,
    *,
    speed: float = 1.0,
    force: float = 0.7,
) -> tuple[Mode, ...]:
    """Return the harmonics of a surface that repeats itself, one line each.

    Parameters
    ----------
    period_mm
        Spatial period of the surface, across its ridges.
    powers
        Powers of the harmonics, (m/s2)^2.
    width
        Relative width of the lines.
    grain
        None for a surface that has this period in all directions.
    speed, force
        Exponents of the power.
    """
    return tuple(
        Line(power, speed, force, period_mm / harmonic, width, grain=grain)
        for harmonic, power in enumerate(powers, start=1)
    )
