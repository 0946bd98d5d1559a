"""Prior covariance of the level at two strokes, for `mmt.texture.field.level_process`.

The level's logarithm is a power law of speed and force plus what departs from it:

- the law, ``c + a ln(speed) + b ln(force)``: c all but free, a and b normal about the usual
  exponents, as in `mmt.texture.field.trend`. It holds the limits: no speed or no force, no
  vibration.
- a smooth departure, a Gaussian process over ln(speed) and ln(force), with the product of two
  Matern covariances of smoothness 5/2 (Rasmussen and Williams, Gaussian Processes for Machine
  Learning, 2006, eq. 4.17): smooth, but not as stiff as a squared exponential.
- where the heading counts, a departure that turns with it: a part that is the same for a stroke
  and its return, as ridges are, and one that is not, as a nap is. Each is a Matern covariance of
  the same smoothness over the chord between headings on a circle (a subset of the plane, where
  it is one; the warping of ibid., eq. 4.31), as sharp as the turn into ridges is, times such
  covariances of its own over speed and force. These are long: what a grain does to the level it
  does much alike at all speeds and forces.

Every term is a product over speed, force and heading, so that on a grid of the three the mean
costs a few matrix products.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.field.trend import USUAL

SLOWEST: Final = 0.01
"""Least speed and force, as a share of the largest, whose logarithms are taken."""

NAMES: Final = (
    "deviation",
    "speed_scale",
    "force_scale",
    "noise",
    "turned_deviation",
    "turned_width",
    "headed_deviation",
    "headed_width",
    "turned_speed_scale",
    "turned_force_scale",
)
"""Hyperparameters, all positive and kept by their logarithms; the first four without headings.

Standard deviations of the departures and lengths in nepers of power, speed and force; widths are
chords, about radians; ``noise`` multiplies the standard deviation that the samples' lengths
explain."""

PLANAR: Final = 4
"""Number of hyperparameters without headings."""

NOISE: Final = 3
"""Index of the noise's hyperparameter."""

PRIOR: Final = np.column_stack(
    [
        np.log([0.2, 1.6, 3.0, 1.0, 0.5, 0.7, 0.15, 1.2, 5.0, 8.0]),
        [0.5, 0.5, 0.5, 0.3, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5],
    ]
)
"""Mean and standard deviation of each hyperparameter's logarithm, shape (10, 2).

Known textures have longer lengths still and smaller departures: the middle lies on the way from
there to lengths that span the plane about once, so that rougher ones fit in. Figures are in the
decision "What a level is told by"."""

_FREE: Final = 25.0  # variance of the level's constant, about the samples' mean
_SPREAD: Final = (0.4, 0.25)  # of the exponents about the usual ones


class Features(NamedTuple):
    """Features of k strokes: ln(speed), ln(force), heading (zeros in the plane), each (k,)."""

    speed: FloatArray
    force: FloatArray
    heading: FloatArray

    @property
    def law(self) -> FloatArray:
        """Logarithm of the usual power law at each, without its constant, shape (k,)."""
        return USUAL[0] * self.speed + USUAL[1] * self.force


class Departures(NamedTuple):
    """Between a pair of sets of strokes: the law's covariance and distances, each (k, l).

    ``half_turn`` and ``turn`` are chords between headings, on a circle that half a turn and one
    that a whole turn goes around once: |sin| of the angle, and 2 |sin| of half of it.
    """

    law: FloatArray
    speed: FloatArray
    force: FloatArray
    half_turn: FloatArray
    turn: FloatArray


def features(points: FloatArray) -> Features:
    """Return the features of normalised points (k, 2) or (k, 3)."""
    if points.shape[1] == 2:
        speed, heading = points[:, 0], np.zeros(len(points))
    else:
        speed = np.hypot(points[:, 0], points[:, 1])
        heading = np.arctan2(points[:, 1], points[:, 0])
    return Features(
        np.log(np.maximum(speed, SLOWEST)), np.log(np.maximum(points[:, -1], SLOWEST)), heading
    )


def departures(a: Features, b: Features, *, directed: bool) -> Departures:
    """Return what the covariance between two sets of strokes is computed from."""
    law = _FREE + _SPREAD[0] ** 2 * np.multiply.outer(a.speed, b.speed)
    law += _SPREAD[1] ** 2 * np.multiply.outer(a.force, b.force)
    speed = np.abs(np.subtract.outer(a.speed, b.speed))
    force = np.abs(np.subtract.outer(a.force, b.force))
    if not directed:
        return Departures(law, speed, force, np.empty((0, 0)), np.empty((0, 0)))
    angle = np.subtract.outer(a.heading, b.heading)
    return Departures(law, speed, force, half_turn(angle), turn(angle))


def half_turn(angle: FloatArray) -> FloatArray:
    """Return the chord between headings of which opposite ones are the same."""
    return np.asarray(np.abs(np.sin(angle)))


def turn(angle: FloatArray) -> FloatArray:
    """Return the chord between headings on the unit circle."""
    return np.asarray(2.0 * np.abs(np.sin(0.5 * angle)))


def law_variance(at: Features) -> FloatArray:
    """Return the prior variance of the law at strokes, shape (k,)."""
    variance = _FREE + (_SPREAD[0] * at.speed) ** 2 + (_SPREAD[1] * at.force) ** 2
    return np.asarray(variance)


def departure_variance(logarithms: FloatArray) -> float:
    """Return the prior variance of all departures from the law, the same everywhere."""
    squares = np.exp(2.0 * logarithms)
    return float(squares[0] + (squares[4] + squares[6] if len(logarithms) > PLANAR else 0.0))


def matern(distance: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
    """Return the Matern covariance of smoothness 5/2, and its slope in ln(length)."""
    r = (np.sqrt(5.0) / length) * distance
    fading = np.exp(-r)
    return (1.0 + r + r * r / 3.0) * fading, r * r * (1.0 + r) / 3.0 * fading


def covariance(between: Departures, logarithms: FloatArray) -> FloatArray:
    """Return the prior covariance of two sets of strokes, shape (k, l).

    Parameters
    ----------
    between
        See `departures`.
    logarithms
        Logarithms of the hyperparameters, shape (4,), or (10,) where the heading counts.
    """
    return covariance_and_slopes(between, logarithms, slopes=False)[0]


def covariance_and_slopes(
    between: Departures, logarithms: FloatArray, *, slopes: bool = True
) -> tuple[FloatArray, dict[int, FloatArray]]:
    """Return the prior covariance, and its slope in each hyperparameter's logarithm.

    The noise, which is no part of the covariance of levels, has none.
    """
    h = np.exp(logarithms)
    speed, in_speed = matern(between.speed, h[1])
    force, in_force = matern(between.force, h[2])
    smooth = h[0] ** 2 * speed * force
    total = between.law + smooth
    found: dict[int, FloatArray] = {}
    if slopes:
        found = {0: 2.0 * smooth, 1: h[0] ** 2 * in_speed * force, 2: h[0] ** 2 * speed * in_force}
    if len(logarithms) == PLANAR:
        return total, found
    speed, in_speed = matern(between.speed, h[8])
    force, in_force = matern(between.force, h[9])
    turned, in_turned = matern(between.half_turn, h[5])
    headed, in_headed = matern(between.turn, h[7])
    around = h[4] ** 2 * turned + h[6] ** 2 * headed
    plane = speed * force
    total += around * plane
    if slopes:
        found[4] = 2.0 * h[4] ** 2 * turned * plane
        found[5] = h[4] ** 2 * in_turned * plane
        found[6] = 2.0 * h[6] ** 2 * headed * plane
        found[7] = h[6] ** 2 * in_headed * plane
        found[8] = around * in_speed * force
        found[9] = around * speed * in_force
    return total, found


def mean_on_grid(
    grid: Features, at: Features, weights: FloatArray, logarithms: FloatArray
) -> FloatArray:
    """Return ``sum_i weights_i covariance(node, sample_i)`` on a grid, its axes in `grid`.

    Shape (headings, speeds, forces), one heading in the plane. By the product of the axes'
    covariances: O(n) exponentials for a node of an axis, not of the grid.
    """
    h = np.exp(logarithms)

    def plane(speed_scale: float, force_scale: float) -> tuple[FloatArray, FloatArray]:
        speed, _ = matern(np.abs(np.subtract.outer(grid.speed, at.speed)), speed_scale)
        force, _ = matern(np.abs(np.subtract.outer(grid.force, at.force)), force_scale)
        return speed, force

    speed, force = plane(h[1], h[2])
    total = h[0] ** 2 * ((speed * weights) @ force.T)
    total += _FREE * weights.sum()
    total += _SPREAD[0] ** 2 * (weights @ at.speed) * grid.speed[:, None]
    total += _SPREAD[1] ** 2 * (weights @ at.force) * grid.force
    if len(logarithms) == PLANAR:
        return np.asarray(total[np.newaxis])
    angle = np.subtract.outer(grid.heading, at.heading)
    around = h[4] ** 2 * matern(half_turn(angle), h[5])[0]
    around += h[6] ** 2 * matern(turn(angle), h[7])[0]
    speed, force = plane(h[8], h[9])
    both = (speed[:, None, :] * force[None, :, :]).reshape(-1, len(weights))
    turning = (around * weights) @ both.T
    return np.asarray(total + turning.reshape(len(grid.heading), *total.shape))


def nodes(axes: Features) -> Features:
    """Return every node of a grid, shape (g,) each: headings outermost, forces innermost."""
    heading, speed, force = np.meshgrid(axes.heading, axes.speed, axes.force, indexing="ij")
    return Features(speed.ravel(), force.ravel(), heading.ravel())


def covariance_on_grid(axes: Features, at: Features, logarithms: FloatArray) -> FloatArray:
    """Return the prior covariance of a grid's nodes, see `nodes`, and n strokes, shape (g, n).

    The same as `covariance`, with exponentials for the nodes of each axis alone.

    Parameters
    ----------
    axes
        Axes of the grid, each of a shape of its own; one heading where the heading does not count.
    at
        The strokes.
    logarithms
        Logarithms of the hyperparameters, shape (4,), or (10,) where the heading counts.
    """
    h = np.exp(logarithms)
    apart_speed = np.abs(np.subtract.outer(axes.speed, at.speed))[:, None]
    apart_force = np.abs(np.subtract.outer(axes.force, at.force))[None]

    def plane(speed_scale: float, force_scale: float) -> FloatArray:
        return matern(apart_speed, speed_scale)[0] * matern(apart_force, force_scale)[0]

    total = h[0] ** 2 * plane(h[1], h[2]) + _FREE
    total += _SPREAD[0] ** 2 * np.multiply.outer(axes.speed, at.speed)[:, None]
    total += _SPREAD[1] ** 2 * np.multiply.outer(axes.force, at.force)[None]
    if len(logarithms) == PLANAR:
        return np.asarray(total.reshape(-1, len(at.speed)))
    angle = np.subtract.outer(axes.heading, at.heading)
    around = h[4] ** 2 * matern(half_turn(angle), h[5])[0]
    around += h[6] ** 2 * matern(turn(angle), h[7])[0]
    total = total + around[:, None, None] * plane(h[8], h[9])
    return np.asarray(total.reshape(-1, len(at.speed)))
