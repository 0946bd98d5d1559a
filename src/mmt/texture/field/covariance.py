"""Prior covariance of a texture's log power over speed, force and heading.

Coordinates are warped: ``u = 1.5 ln(speed + 0.15)`` of the normalised speed, and ``v`` likewise of
the force. They are nearly logarithmic for most strokes and nearly linear near rest, where little
power is left. The log power is the sum of a linear part and departures from it:

- ``c + a u + b v``: c with a very broad prior, a and b normal.
- a Gaussian process over u and v, with the product of two Matern covariances of smoothness 3/2
  (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, eq. 4.17).
- a rough departure: the same with the width of a cell (`CELL_WIDTHS`) as length on both axes.
  Without it, a level that varies between neighbouring strokes would count as scatter about a
  smooth level, and as known around any stroke that was made often.
- if the heading counts, two more departures, each a Matern covariance over the chord between
  headings times such covariances over u and v: one is equal for a stroke and its return, as for
  ridges, the other is not, as for a nap.

Every term is a product over the axes. Cells and grids have few coordinates on each axis, so that
their matrices take few exponentials.

Hyperparameters are not optimised. `settings` spreads a fixed number of them evenly over their
prior, and the posterior is the mixture over all of them, weighted by their evidence
(`mmt.texture.field.posterior`). The prior's figures are in `HYPERPRIOR`.
"""

from functools import cache
from typing import Final, NamedTuple, TypeVar

import numpy as np
from scipy.special import ndtri

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.interpolation.interpolant import NEAR_REST
from mmt.texture.linear_algebra import product

Values = TypeVar("Values", FloatArray, IntArray)


class LogNormal(NamedTuple):
    """Log-normal distribution: median, and standard deviation of the logarithm."""

    median: float
    spread: float


HYPERPRIOR: Final = {
    "departure": LogNormal(0.6, 0.8),
    "speed_scale": LogNormal(0.6, 0.7),
    "force_scale": LogNormal(0.8, 0.7),
    "rough": LogNormal(0.15, 1.0),
    "turned": LogNormal(0.5, 0.7),
    "turned_width": LogNormal(0.7, 0.5),
    "headed": LogNormal(0.15, 0.7),
    "headed_width": LogNormal(1.2, 0.5),
}
"""Prior of each hyperparameter: standard deviations of the departures in nepers of power, lengths
in u and v, widths as chords on the unit circle.

The first three are rounded from fits to 50 single HaTT models (medians 0.71, 0.57 and 0.78, spreads
0.9 to 1.1). The fourth is rounded too: its evidence from the same models is within 0.2 nepers per
model of the evidence of the best median. The other four are broad guesses."""

CELL_WIDTHS: Final = (0.15, 0.5)
"""Width in u and v of the cells in which blocks are summed (`mmt.texture.field.cells`), without and
with heading. It is also the length of the rough departure, as finer detail is not resolved."""

SLOPES: Final = ((1.5, 0.5), (0.5, 0.3))
"""Mean and standard deviation, of a and of b, as in the same models."""

_FREE: Final = 16.0  # variance of c about the blocks' mean
_PER_COORDINATE: Final = 1.5
_PLANAR: Final = 4
_HEADED_LENGTHS: Final = 8.0
"""Ratio of the lengths with heading to those without: grain acts alike at all speeds."""


class Coordinates(NamedTuple):
    """Warped speed and force, and heading (rad; zeros in the plane) of k strokes, each (k,)."""

    u: FloatArray
    v: FloatArray
    heading: FloatArray

    @property
    def law(self) -> FloatArray:
        """Prior mean of the log power without its constant, shape (k,)."""
        return SLOPES[0][0] * self.u + SLOPES[1][0] * self.v


def warped(normalised: FloatArray) -> FloatArray:
    """Return the coordinate of a normalised speed or force."""
    return np.asarray(_PER_COORDINATE * np.log(normalised + NEAR_REST))


FIRST: Final = float(warped(np.zeros(1))[0])
"""Coordinate of no speed and of no force, at which the first cell begins."""


def coordinates(points: FloatArray) -> Coordinates:
    """Return the coordinates of normalised points, (k, 2) or (k, 3)."""
    if points.shape[1] == 2:
        speed, heading = points[:, 0], np.zeros(len(points))
    else:
        speed = np.hypot(points[:, 0], points[:, 1])
        heading = np.arctan2(points[:, 1], points[:, 0])
    return Coordinates(warped(speed), warped(points[:, -1]), heading)


def points_at(at: Coordinates, *, directed: bool) -> FloatArray:
    """Return the normalised points of coordinates, (k, 2) or (k, 3)."""
    speed, force = (np.exp(axis / _PER_COORDINATE) - NEAR_REST for axis in (at.u, at.v))
    if not directed:
        return np.column_stack([speed, force])
    return np.column_stack([speed * np.cos(at.heading), speed * np.sin(at.heading), force])


def grid_nodes(axes: Coordinates) -> Coordinates:
    """Return every node of a grid, (g,) each: headings outermost, forces innermost."""
    heading, u, v = np.meshgrid(axes.heading, axes.u, axes.v, indexing="ij")
    return Coordinates(u.ravel(), v.ravel(), heading.ravel())


@cache
def settings(count: int, *, directed: bool, rough: bool = True) -> FloatArray:
    """Return hyperparameters spread evenly over their prior, (count, 4) or (count, 8).

    They are quantiles at the points of the additive recurrence that generalises the golden ratio
    (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018). ``rough`` says
    whether there is a rough departure.
    """
    names = list(HYPERPRIOR)[: None if directed else _PLANAR]
    spread = [column for column, name in enumerate(names) if rough or name != "rough"]
    base = 1.5
    for _ in range(32):  # the root of x^(d + 1) = x + 1
        base = (1.0 + base) ** (1.0 / (len(spread) + 1.0))
    steps = base ** -np.arange(1.0, len(spread) + 1.0)
    shares = (0.5 + np.outer(np.arange(1, count + 1), steps)) % 1.0
    middles, spreads = np.array([HYPERPRIOR[names[column]] for column in spread]).T
    every = np.zeros((count, len(names)))
    every[:, spread] = middles * np.exp(spreads * ndtri(0.002 + 0.996 * shares))
    every.setflags(write=False)
    return every


def prior_covariance(a: Coordinates, b: Coordinates, every: FloatArray) -> FloatArray:
    """Return the prior covariance between k and l strokes.

    Parameters
    ----------
    a, b
        Coordinates of k and of l strokes.
    every
        One row of `settings`, or s of them.

    Returns
    -------
    covariance
        Shape (k, l), or (s, k, l).
    """
    rows = np.array(every, np.float64, ndmin=2)  # writable, for compiled code
    out = np.empty((len(rows), len(a.u), len(b.u)))
    slopes = np.array(SLOPES)[:, 1]
    _covariances(np.array(a), np.array(b), rows, slopes, out)
    return out.reshape(np.shape(every)[:-1] + out.shape[1:])


@kernel("i8(f8[::1], i8, f8)", "i8(i8[::1], i8, i8)", inner=True)
def _place_among(ascending: Values, count: int, value: float) -> int:
    """Return where a value is, or belongs, among the first `count` ascending ones."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if ascending[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@kernel("f8[::1](f8[::1], i8[::1])", "i8[::1](i8[::1], i8[::1])")
def different(values: Values, which: IntArray) -> Values:
    """Return the distinct values, sorted; write the index of each value among them to `which`.

    Costs O(n log d + d^2) for d distinct of n values: they are few on an axis.
    """
    own, count = np.empty_like(values), 0
    for i in range(len(values)):
        place = _place_among(own, count, values[i])
        if place == count or own[place] != values[i]:
            for later in range(count, place, -1):
                own[later] = own[later - 1]
            own[place] = values[i]
            count += 1
    for i in range(len(values)):
        which[i] = _place_among(own, count, values[i])
    return own[:count].copy()


@kernel("f8(f8, f8)", inner=True)
def _matern_32(distance: float, length: float) -> float:
    """Return the Matern covariance of smoothness 3/2."""
    r = (np.sqrt(3.0) / length) * abs(distance)
    return float((1.0 + r) * np.exp(-r))


@kernel("f8[:, ::1](f8[:], f8[:], f8)")
def matern(a: FloatArray, b: FloatArray, length: float) -> FloatArray:
    """Return the Matern covariance of smoothness 3/2 between k and l coordinates, (k, l)."""
    out = np.empty((len(a), len(b)))
    for i in range(len(a)):
        for j in range(len(b)):
            out[i, j] = _matern_32(a[i] - b[j], length)
    return out


@kernel("f8[:, ::1](f8[:], f8[:], f8[:])")
def _around(a: FloatArray, b: FloatArray, setting: FloatArray) -> FloatArray:
    """Return the covariance of the departures with heading, at equal speeds and forces, (k, l)."""
    out = np.empty((len(a), len(b)))
    for i in range(len(a)):
        for j in range(len(b)):
            angle = a[i] - b[j]  # ridges are equal for opposite headings
            ridges = setting[4] ** 2 * _matern_32(np.sin(angle), setting[5])
            out[i, j] = ridges + setting[6] ** 2 * _matern_32(2.0 * np.sin(0.5 * angle), setting[7])
    return out


@kernel("void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:], f8[:, :, ::1])")
def _covariances(
    a: FloatArray, b: FloatArray, every: FloatArray, slopes: FloatArray, out: FloatArray
) -> None:
    """Set the covariances (s, k, l) of `prior_covariance`."""
    of_a, of_b = np.empty(a.shape, np.int64), np.empty(b.shape, np.int64)
    u_a, u_b = different(a[0], of_a[0]), different(b[0], of_b[0])
    v_a, v_b = different(a[1], of_a[1]), different(b[1], of_b[1])
    heading_a, heading_b = different(a[2], of_a[2]), different(b[2], of_b[2])
    directed = every.shape[1] > _PLANAR
    width = CELL_WIDTHS[1] if directed else CELL_WIDTHS[0]
    rough_u, rough_v = matern(u_a, u_b, width), matern(v_a, v_b, width)
    around, wide_u, wide_v = rough_u, rough_u, rough_v
    for s in range(len(every)):
        setting = every[s]
        u, v = matern(u_a, u_b, setting[1]), matern(v_a, v_b, setting[2])
        smooth, rough = setting[0] ** 2, setting[3] ** 2
        if directed:
            around = _around(heading_a, heading_b, setting)
            wide_u = matern(u_a, u_b, _HEADED_LENGTHS * setting[1])
            wide_v = matern(v_a, v_b, _HEADED_LENGTHS * setting[2])
        for i in range(a.shape[1]):
            slope_u, slope_v = slopes[0] ** 2 * a[0, i], slopes[1] ** 2 * a[1, i]
            m, n, h = of_a[0, i], of_a[1, i], of_a[2, i]
            for j in range(b.shape[1]):
                p, q = of_b[0, j], of_b[1, j]
                total = smooth * u[m, p] * v[n, q] + rough * rough_u[m, p] * rough_v[n, q]
                if directed:
                    total += around[h, of_b[2, j]] * wide_u[m, p] * wide_v[n, q]
                out[s, i, j] = total + slope_u * b[0, j] + slope_v * b[1, j] + _FREE


def variance(at: Coordinates, setting: FloatArray) -> FloatArray:
    """Return the prior variance at k strokes, (k,)."""
    total = _FREE + (SLOPES[0][1] * at.u) ** 2 + (SLOPES[1][1] * at.v) ** 2
    total = total + setting[0] ** 2 + setting[3] ** 2
    if len(setting) > _PLANAR:
        total = total + setting[4] ** 2 + setting[6] ** 2
    return np.asarray(total)


def mean_on_grid(
    axes: Coordinates, at: Coordinates, weights: FloatArray, every: FloatArray
) -> FloatArray:
    """Return ``sum_ki weights_ki covariance_k(node, stroke_i)``, (headings, speeds, forces).

    The product of the axes' covariances takes an exponential per node of an axis and different
    coordinate. The result has one heading if the heading does not count.

    Parameters
    ----------
    axes
        The grid's axes.
    at
        Coordinates of n strokes.
    weights
        Shape (k, n).
    every
        Rows of `settings`, one for each row of `weights`, (k, h).
    """
    all_weights, rough = weights.sum(axis=0), np.square(every[:, 3]) @ weights
    length = CELL_WIDTHS[every.shape[1] > _PLANAR]
    of_u, of_v = np.empty((2, len(at.u)), np.int64)
    different_u, different_v = different(at.u, of_u), different(at.v, of_v)
    u, v = matern(axes.u, different_u, length), matern(different_v, axes.v, length)
    total = product(u[:, of_u] * rough, v[of_v])
    total += SLOPES[0][1] ** 2 * (all_weights @ at.u) * axes.u[:, None]
    total += SLOPES[1][1] ** 2 * (all_weights @ at.v) * axes.v
    total += _FREE * all_weights.sum()
    for own, setting in zip(weights, every, strict=True):
        u = matern(axes.u, different_u, setting[1])
        v = matern(different_v, axes.v, setting[2])
        total += product(u[:, of_u] * (setting[0] ** 2 * own), v[of_v])
    if every.shape[1] == _PLANAR:
        return np.asarray(total[np.newaxis])
    turning = np.zeros((len(axes.heading), total.size))
    for own, setting in zip(weights, every, strict=True):
        u = matern(at.u, axes.u, _HEADED_LENGTHS * setting[1])
        v = matern(at.v, axes.v, _HEADED_LENGTHS * setting[2])
        both = (u[:, :, None] * v[:, None, :]).reshape(len(own), -1)
        turning += product(_around(axes.heading, at.heading, setting) * own, both)
    return np.asarray(total + turning.reshape(len(axes.heading), *total.shape))
