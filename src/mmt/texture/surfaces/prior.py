"""Gaussian process prior of the band powers of a surface.

The logarithms of nine band powers are turned by an orthonormal cosine transform into nine
components: the mean (the *level*), the *tilt* of the spectrum, and ever finer features of its
shape. Over the logarithms of speed and force, l and g, each is a Gaussian process (Rasmussen and
Williams, "Gaussian Processes for Machine Learning", 2006, section 2.7):

    f = c + a l + b g + r(l, g),   c, a, b normal,   r of squared exponential covariance.

The level follows a power law of speed and force as far as is published for textures (power as
speed^0.8..1.4 and force^0.4..1), and bends away from it by a residual r. Predictions where the
surface was not touched follow: near its samples they are uncertain by the residual, far from them
by the slopes, and for an untouched surface by the wide prior of c. Vibration falls towards high
frequencies, and the finer a feature, the smaller; the widths are near those at which stays on the
known textures are likeliest, on the wide side: a prior that is too wide takes two textures that are
merely alike for the same.

How rough r is differs between textures: each of `SETTINGS` is held possible. One has *lines*,
which move with the speed v through the bands. These are equally wide, and a line of period p
is at v / p: r is then alike at like speeds, not at like logarithms.

Where the heading is known as well, those of `GRAINED` are held possible besides: with a *grain*,
for which l is the logarithm of the effective speed across it, v sqrt(c^2 + a^2 s^2), c and s being
cosine and sine of the angle from its axis to the heading and a the share of the speed along it; and
without one, r and a constant h being only alike at like headings. What depends on the heading
is the same there and back, but for a nap.
"""

import math
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.texture.surfaces.blocks import BANDS

NOISE: Final = 0.19
"""Variance of a band's log power over blocks of white noise (measured; 2 / degrees of freedom)."""


class Prior(NamedTuple):
    """Prior of one kind of component, in natural logarithms of the power in a band.

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
    """Roughness of a surface, and the dependence of its texture on the heading.

    ``residual`` and ``length``: size of r, and its length in the logarithms of speed and force.
    ``noise``: over `NOISE`. ``lines`` and ``period``: size of a further residual, and its length in
    the speed itself, in 100 mm/s: a line moves with the speed through bands of equal width.

    ``across``: heading across a grain (rad). The speed is the effective one, v sqrt(c^2 +
    along^2 s^2), where ``along`` is 1 if there is no grain. ``crossed``: the angle from there to
    a second direction with the same vibration (rad), 0 for none. ``nap``: factor on what
    differs there and back.

    ``turning``: factor on a part that varies with the heading; ``turn``: its length, as a distance
    on the unit circle of twice the heading, for a grain is the same there and back but for a nap;
    infinite for no such part. Without a grain the residuals are alike at like headings only.

    ``weight``: beside the other settings', before any block.
    """

    residual: float
    length: float
    noise: float
    lines: float = 0.0
    period: float = 1.0
    turning: float = 0.0
    turn: float = math.inf
    across: float = 0.0
    along: float = 1.0
    crossed: float = 0.0
    nap: float = 0.0
    weight: float = 1.0


def settings_of(*settings: Setting) -> RecordArray:
    """Return settings as records, whose fields are those of `Setting`."""
    return np.array(list(settings), dtype=[(name, np.float64) for name in Setting._fields])


def _along_axes() -> Iterator[Setting]:
    """Yield textures with a grain along each of many axes.

    Fibres, smooth; fibres with a nap and weak lines; ridges; threads that cross at right angles;
    and the diamonds of a knurl, whose ridges cross at 60 degrees.
    """
    fibres = Setting(0.12, 0.7, 1.2, turning=0.15, turn=0.8, along=0.35)
    nap = Setting(0.25, 0.7, 1.2, 0.3, 0.5, turning=0.3, turn=0.8, along=0.35, nap=0.4)
    ridges = Setting(0.25, 0.7, 1.2, 0.6, 0.5, turning=0.3, turn=0.8, along=0.15)
    crossed = Setting(0.12, 0.7, 1.2, 0.5, 0.35, turning=0.3, turn=0.8, along=0.35)
    threads = crossed._replace(crossed=math.pi / 2.0)
    diamonds = crossed._replace(crossed=math.pi / 3.0)
    for setting, axes in ((fibres, 12), (nap, 12), (ridges, 24), (threads, 12), (diamonds, 18)):
        turn = math.pi / (2.0 if setting is threads else 1.0)  # after that all is the same again
        for number in range(axes):
            yield setting._replace(across=turn * (number + 0.5) / axes, weight=1.0 / axes)


SETTINGS: Final = settings_of(
    Setting(0.12, 0.7, 1.1),
    Setting(0.2, 0.5, 1.3),
    Setting(0.4, 0.35, 1.5),
    Setting(0.6, 0.7, 1.8),
    Setting(0.1, 0.7, 1.4, lines=0.5, period=0.35),
)

GRAINED: Final = settings_of(
    Setting(0.15, 0.7, 1.2, turning=0.4, turn=1.0),
    Setting(0.25, 0.6, 1.2, turning=0.8, turn=0.9),
    Setting(0.5, 0.5, 1.2, turning=0.5, turn=0.7),
    Setting(0.5, 0.4, 1.8, turning=1.0, turn=0.8),
    *_along_axes(),
)
"""Settings of surfaces whose texture depends on the heading."""


@cache
def cosine_transform() -> FloatArray:
    """Return the orthonormal transform (`BANDS`, `BANDS`); its first row is the level's."""
    order, band = np.arange(BANDS)[:, None], np.arange(BANDS)[None, :]
    rows: FloatArray = np.sqrt(2.0 / BANDS) * np.cos(np.pi * order * (band + 0.5) / BANDS)
    rows[0] = np.sqrt(1.0 / BANDS)
    rows.setflags(write=False)
    return rows
