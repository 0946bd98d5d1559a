"""How a part of a known texture depends on the heading of a stroke."""

from dataclasses import dataclass
from math import cos, radians, sin
from typing import TypeVar

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError

Number = TypeVar("Number", float, FloatArray)


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
