"""What is known of the bands of a surface before it is touched, as Gaussian processes.

The logarithms of nine band powers are turned by an orthonormal cosine transform into nine
components: the mean (the *level*), the *tilt* of the spectrum, and ever finer features of its
shape. Over the logarithms of speed and force, l and g, each is a Gaussian process (Rasmussen and
Williams, "Gaussian Processes for Machine Learning", 2006, section 2.7):

    f = c + a l + b g + r(l, g),   c, a, b normal,   r of squared exponential covariance.

The level follows a power law of speed and force as far as is published for textures (power as
speed^0.8..1.4 and force^0.4..1), and bends away from it by a residual r. What a surface is like
where it was not touched follows: near its samples it is known to within the residual, far
from them only to within the slopes, and of a surface that was never touched nothing is known but
the wide prior of c. Vibration falls towards high frequencies, and the finer a feature, the smaller;
the widths are near those at which stays on the known textures are likeliest, on the wide side: a
prior that is too wide takes two textures that are merely alike for the same. How rough r is differs
between textures (a ribbed one has lines that move with the speed through the bands): each of
`SETTINGS` is held possible.

Where the heading is known as well, a texture may depend on it or not: beside `SETTINGS`, those of
`GRAINED` are held possible, in which r and a constant h are only alike at like headings. A grain is
the same there and back, but for a nap: that counts little (`REVERSAL`).
"""

import math
from collections.abc import Mapping
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from mmt.arrays import FloatArray
from mmt.texture.surfaces.blocks import BANDS

NOISE: Final = 0.19
"""Variance of a band's log power over blocks of white noise (measured; 2 / degrees of freedom)."""


class Prior(NamedTuple):
    """Of one kind of component, in natural logarithms of the power in a band.

    ``first`` and ``last``: the components that it holds for, half-open. ``mean``: of c, a and b.
    ``constant``, ``per_speed``, ``per_force``: their standard deviations; ``per_heading``: of a
    part that varies with the heading. ``scale``: variance of the component over that of a band,
    for the level is what all bands have in common. ``roughness``: factor on the residual.
    """

    first: int
    last: int
    mean: tuple[float, float, float]
    constant: float
    per_speed: float
    per_force: float
    per_heading: float
    scale: float
    roughness: float


PRIORS: Final[Mapping[str, Prior]] = {
    "level": Prior(0, 1, (-3.0, 1.1, 0.65), 2.2, 0.35, 0.2, 0.75, float(BANDS), 0.6),
    "tilt": Prior(1, 2, (2.0, 0.0, 0.0), 2.0, 0.6, 0.4, 0.8, 1.0, 2.0),
    "coarse": Prior(2, 4, (0.0, 0.0, 0.0), 0.6, 0.5, 0.2, 0.5, 1.0, 1.5),
    "fine": Prior(4, BANDS, (0.0, 0.0, 0.0), 0.3, 0.2, 0.1, 0.2, 1.0, 1.0),
}


REVERSAL: Final = 3.0
"""Length, on the unit circle, over which a texture differs there and back."""


class Setting(NamedTuple):
    """How rough a surface may be: size and length of the residual, and the noise over `NOISE`.

    ``turning``: factor on what varies with the heading. ``turn``: length of that, as a distance
    on the unit circle of twice the heading, for a grain is the same there and back but for a nap;
    infinite where the heading does not count.
    """

    residual: float
    length: float
    noise: float
    turning: float = 0.0
    turn: float = math.inf


SETTINGS: Final = (
    Setting(0.12, 0.7, 1.1),
    Setting(0.2, 0.5, 1.3),
    Setting(0.4, 0.35, 1.5),
    Setting(0.6, 0.7, 1.8),
)

GRAINED: Final = (
    Setting(0.15, 0.7, 1.2, 0.4, 1.0),
    Setting(0.25, 0.6, 1.2, 0.8, 0.9),
    Setting(0.5, 0.5, 1.2, 0.5, 0.7),
    Setting(0.5, 0.4, 1.8, 1.0, 0.8),
)
"""Of surfaces whose texture depends on the heading."""


@cache
def turning() -> FloatArray:
    """Return the orthonormal transform (`BANDS`, `BANDS`); its first row is the level's."""
    order, band = np.arange(BANDS)[:, None], np.arange(BANDS)[None, :]
    rows: FloatArray = np.sqrt(2.0 / BANDS) * np.cos(np.pi * order * (band + 0.5) / BANDS)
    rows[0] = np.sqrt(1.0 / BANDS)
    rows.setflags(write=False)
    return rows


def mean_of(prior: Prior, inputs: FloatArray) -> FloatArray:
    """Return the prior mean of a component at inputs (n, 2) or (n, 4), shape (n, 1)."""
    constant, per_speed, per_force = prior.mean
    mean: FloatArray = constant + per_speed * inputs[:, :1] + per_force * inputs[:, 1:2]
    return np.asarray(np.sqrt(prior.scale) * mean, dtype=np.float64)


class Distances:
    """What covariances between inputs (n, d) and (m, d) are made of, computed once."""

    def __init__(self, one: FloatArray, other: FloatArray) -> None:
        self._speeds = np.outer(one[:, 0], other[:, 0])
        self._forces = np.outer(one[:, 1], other[:, 1])
        self._apart = np.square(one[:, None, 0] - other[None, :, 0])
        self._apart += np.square(one[:, None, 1] - other[None, :, 1])
        self._residuals: dict[float, FloatArray] = {}
        self._alike: dict[float, FloatArray] = {}
        self._turned: FloatArray | None = None
        self._reversed: FloatArray
        if one.shape[1] == 4:
            cosine = one[:, 2:] @ other[:, 2:].T
            self._turned = 4.0 * (1.0 - cosine**2)
            self._reversed = np.exp((cosine - 1.0) / REVERSAL**2)

    def covariance(self, prior: Prior, setting: Setting) -> FloatArray:
        """Return the prior covariance of a component, shape (n, m)."""
        residual = self._residuals.get(setting.length)
        if residual is None:
            residual = np.exp(self._apart / (-2.0 * setting.length**2))
            self._residuals[setting.length] = residual
        total: FloatArray = (setting.residual * prior.roughness) ** 2 * residual
        if self._turned is not None and setting.turn < math.inf:
            alike = self._alike.get(setting.turn)
            if alike is None:
                alike = self._reversed * np.exp(self._turned / (-2.0 * setting.turn**2))
                self._alike[setting.turn] = alike
            total = (total + (setting.turning * prior.per_heading) ** 2) * alike
        total += prior.constant**2
        total += prior.per_speed**2 * self._speeds
        total += prior.per_force**2 * self._forces
        total *= prior.scale
        return total
