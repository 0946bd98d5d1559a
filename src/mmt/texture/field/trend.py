"""Power law of the level of an anisotropic texture over speed and force.

A hand at rest, or one that does not press, feels nothing. In the plane of speed and force two
edges say so; in the space of velocity and force it is a line and a face with a corner between
them, and whatever is interpolated linearly is zero in the whole corner, where a light and slow
stroke is. So the level's course is taken out first: ``speed^a force^b``, a and b fitted to the
samples, and what is interpolated is the level over it. It is put back at the point in question,
and is zero at rest.

The exponents are those of ridge regression of the level's logarithm: published powers grow about
as ``speed^1 force^0.7``, and the fewer samples there are the less they may say otherwise.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel
from mmt.core.errors import InputError

USUAL: Final = (1.0, 0.7)
"""Exponents of the power in speed and force about which the fit is drawn."""

_SPREAD: Final = 0.3  # of the exponents of textures about the usual ones
_SCATTER: Final = 1.0  # of a level's logarithm about the law: heading, shape of the spectrum
_BOUNDS: Final = (0.2, 2.5)
_SLOWEST: Final = 0.01
"""Share of the largest speed and force below which the level falls to zero linearly."""


class Trend(NamedTuple):
    """Exponents of normalised speed and force; both zero where nothing is taken out."""

    speed_exponent: float
    force_exponent: float

    def check(self) -> None:
        """Raise `InputError` where these cannot come from `fit_trend`."""
        least, largest = 0.5 * _BOUNDS[0], _BOUNDS[1]  # of an amplitude, of a power
        if not all(least <= exponent <= largest for exponent in self):
            raise InputError(f"exponents {tuple(self)} of the level: {least} to {largest}")


NO_TREND: Final = Trend(0.0, 0.0)


@kernel("f8(f8, f8, f8[::1])")
def trend_at(speed_exponent: float, force_exponent: float, point: FloatArray) -> float:
    """Return the power law at a normalised point (3,) of velocity and force."""
    speed, force = np.sqrt(point[0] * point[0] + point[1] * point[1]), point[2]
    law = max(speed, _SLOWEST) ** speed_exponent * max(force, _SLOWEST) ** force_exponent
    return float(law * min(speed / _SLOWEST, 1.0) * min(force / _SLOWEST, 1.0))


def fit_trend(points: FloatArray, level: FloatArray, *, is_amplitude: bool) -> Trend:
    """Fit the exponents to samples.

    Parameters
    ----------
    points
        Normalised velocity and force, shape (n, 3).
    level
        Shape (n,), not negative; zeros are ignored.
    is_amplitude
        Whether the level is the root of a power: exponents are then half as large.
    """
    power = 2.0 if is_amplitude else 1.0
    usual = np.array(USUAL)
    known = level > 0.0
    if not known.any():
        return Trend(*(usual / power).tolist())
    logarithms = np.log(_bounded(points[known]))
    logarithms -= logarithms.mean(axis=0)
    target = power * np.log(level[known])
    target = target - target.mean()
    ridge = (_SCATTER / _SPREAD) ** 2 * np.eye(2)
    excess = np.linalg.solve(
        logarithms.T @ logarithms + ridge, logarithms.T @ (target - logarithms @ usual)
    )
    speed_exponent, force_exponent = np.clip(usual + excess, *_BOUNDS) / power
    return Trend(float(speed_exponent), float(force_exponent))


def without_trend(points: FloatArray, level: FloatArray, trend: Trend) -> FloatArray:
    """Return the level (n,) of samples over the power law at their points (n, 3)."""
    speed, force = _bounded(points).T
    law: FloatArray = speed**trend.speed_exponent * force**trend.force_exponent
    ratio: FloatArray = level / law
    return ratio


def _bounded(points: FloatArray) -> FloatArray:
    """Return speed and force (n, 2), none below the slowest."""
    speed = np.hypot(points[:, 0], points[:, 1])
    bounded: FloatArray = np.maximum(np.column_stack([speed, points[:, 2]]), _SLOWEST)
    return bounded
