"""What is known of the bands of a surface before it is touched, as a Gaussian process.

The logarithms of nine band powers are turned by an orthonormal cosine transform into the mean,
the *level*, and eight numbers that say the *shape*. Over the logarithms of speed and force, l
and g, each is a Gaussian process (Rasmussen and Williams, "Gaussian Processes for Machine
Learning", 2006, section 2.7):

    f = c + a l + b g + r(l, g),   c, a, b normal,   r of squared exponential covariance.

The level follows a power law of speed and force as far as is published for textures (power as
speed^0.8..1.4 and force^0.4..1), and bends away from it by a residual r. What a surface is like
where it was not touched follows: near its samples it is known to within the residual, far
from them only to within the slopes, and of a surface that was never touched nothing is known but
the wide prior of c. The widths are a choice, `LEVEL` and `SHAPE`; the residual's size and length
and the noise of a block are chosen by evidence for each surface.
"""

from functools import cache
from typing import Final, NamedTuple

import numpy as np

from mmt.arrays import FloatArray
from mmt.texture.surfaces.blocks import BANDS

NOISE: Final = 0.19
"""Variance of a band's log power over blocks of white noise (measured; 2 / degrees of freedom)."""


class Prior(NamedTuple):
    """Standard deviations of one kind of component, in natural logarithms of power a band.

    ``mean`` of c, and the slopes' means over l and g; ``constant``, ``per_speed``,
    ``per_force`` of c, a and b; ``per_heading`` of a part that varies with the heading, its
    shape being that of a residual over the unit circle.
    """

    mean: tuple[float, float, float]
    constant: float
    per_speed: float
    per_force: float
    per_heading: float


LEVEL: Final = Prior((-3.0, 1.1, 0.65), 2.2, 0.35, 0.25, 0.5)
SHAPE: Final = Prior((0.0, 0.0, 0.0), 1.3, 0.5, 0.35, 0.4)


class Roughness(NamedTuple):
    """What evidence chooses: size and length of the residual, and the noise over `NOISE`."""

    residual: float
    length: float
    noise: float


RESIDUALS: Final = {"level": (0.1, 0.2, 0.4), "shape": (0.15, 0.35, 0.7)}
LENGTHS: Final = (0.3, 0.7)
NOISES: Final = (1.0, 1.6, 2.6)
USUAL: Final = {"level": Roughness(0.2, 0.3, 1.6), "shape": Roughness(0.35, 0.3, 1.6)}
"""Before there is evidence."""

_HEADING_LENGTH: Final = 0.7


@cache
def turning() -> FloatArray:
    """Return the orthonormal transform (`BANDS`, `BANDS`); its first row is the level's."""
    order, band = np.arange(BANDS)[:, None], np.arange(BANDS)[None, :]
    rows: FloatArray = np.sqrt(2.0 / BANDS) * np.cos(np.pi * order * (band + 0.5) / BANDS)
    rows[0] = np.sqrt(1.0 / BANDS)
    rows.setflags(write=False)
    return rows


def mean_of(prior: Prior, inputs: FloatArray) -> FloatArray:
    """Return the prior mean a band at inputs (n, 2) or (n, 4), shape (n,)."""
    constant, per_speed, per_force = prior.mean
    mean: FloatArray = constant + per_speed * inputs[:, 0] + per_force * inputs[:, 1]
    return mean


def covariance(prior: Prior, rough: Roughness, one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the prior covariance a band between inputs (n, d) and (m, d), shape (n, m)."""
    total = np.full((len(one), len(other)), prior.constant**2)
    total += prior.per_speed**2 * np.outer(one[:, 0], other[:, 0])
    total += prior.per_force**2 * np.outer(one[:, 1], other[:, 1])
    apart = (one[:, None, 0] - other[None, :, 0]) ** 2
    apart += (one[:, None, 1] - other[None, :, 1]) ** 2
    residual = rough.residual**2 * np.exp(apart / (-2.0 * rough.length**2))
    if one.shape[1] == 4:
        turned = 2.0 - 2.0 * (one[:, 2:] @ other[:, 2:].T)  # the chord, squared
        alike = np.exp(turned / (-2.0 * _HEADING_LENGTH**2))
        residual *= alike
        total += prior.per_heading**2 * alike
    total += residual
    return total
