"""Interpolation of level and filter over a model's input space, in arrays for compiled code.

There are two ways: piecewise linearly over a Delaunay triangulation of samples and boundary points,
and by the network of paper B through the samples. Either gives a level that is not negative and
line spectral frequencies (LSF) that ascend strictly in (0, pi).

A model's kernel parameters are one array: a few numbers at the indices below, then, for some
models, a table of the level, which is used instead of the interpolant's. The table holds logarithms
of the level on a grid that is even in ln(speed + `NEAR_REST`), ln(force + `NEAR_REST`) and heading,
as are the cells of a field. Below the least speed and force of the grid the level falls to zero
linearly: a hand at rest feels nothing. A look-up costs two logarithms and an exponential, and an
arctangent more if the heading counts.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression import LARGEST_ORDER, TINY
from mmt.texture.autoregression.lsf import lsf_inverse_gain
from mmt.texture.interpolation.delaunay import linear_into
from mmt.texture.interpolation.networks import network_into

SCRATCH: Final = 4 * LARGEST_ORDER + 1
"""Length of the scratch array that `interpolate_into` needs."""

PER_SPEED, PER_FORCE, DIMENSIONS, MODEL_ORDER = range(4)
"""Indices in `TextureModel.kernel_parameters`: one array costs a compiled call less than four
numbers."""

SLOWEST: Final = 0.01
"""Least speed and force of the table, as a share of the largest."""

NEAR_REST: Final = 0.15
"""Speed and force, as a share of the largest, below which the grid is nearly linear."""

PLANAR_SHAPE: Final = (1, 41, 41)
"""Headings, speeds and forces of a table without headings."""

DIRECTED_SHAPE: Final = (48, 17, 17)
"""Headings (over a whole turn), speeds and forces of a table with headings."""

TABLE_SIZES: Final = 4
"""Index of the table's shape in `TextureModel.kernel_parameters`; zeros if there is no table."""

TABLE: Final = TABLE_SIZES + 3
"""Index of the table's first value."""

_LOWEST: Final = np.log(SLOWEST + NEAR_REST)
_PER_LOGARITHM: Final = 1.0 / (np.log(1.0 + NEAR_REST) - _LOWEST)
_PER_RADIAN: Final = 0.5 / np.pi


class Interpolant(NamedTuple):
    """Arrays by which `interpolate_into` finds values.

    Attributes
    ----------
    rows
        Coordinates, then values or weights, shape (n, d + 1 + order).
    links
        Simplices as in `mmt.texture.interpolation.delaunay.Triangulation`; none of a network.
    tail
        Further numbers of a network, see `mmt.texture.interpolation.networks`.
    """

    rows: FloatArray
    links: IntArray
    tail: FloatArray

    @property
    def is_network(self) -> bool:
        """Whether it is a network, not a triangulation."""
        return len(self.links) == 0


@kernel("i8(f8[:, ::1], i8[:, ::1], f8[:, ::1], i8, f8[::1], f8[::1], f8[::1])", inner=True)
def interpolate_into(
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    hint: int,
    point: FloatArray,
    values: FloatArray,
    scratch: FloatArray,
) -> int:
    """Write level and LSF (1 + order,) at a normalised point (d,), without allocation.

    `rows`, `links` and `tail` are those of an `Interpolant`. The search begins at the simplex
    `hint`, the last call's result or any integer. `scratch` holds `SCRATCH` numbers or more.
    """
    if len(links) == 0:
        network_into(rows, tail, point, values, scratch)
        return 0
    return linear_into(rows, links, hint, point, values, scratch)


def table_grid(*, directed: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the table's axes: normalised speeds and forces, and headings."""
    headings, speeds, forces = DIRECTED_SHAPE if directed else PLANAR_SHAPE
    highest = np.log(1.0 + NEAR_REST)
    speed, force = (
        np.exp(np.linspace(_LOWEST, highest, count)) - NEAR_REST for count in (speeds, forces)
    )
    return speed, force, np.linspace(0.0, 2.0 * np.pi, headings, endpoint=False)


@kernel("f8(f8[::1], f8, f8, f8)", inner=True)
def tabulated_level(parameters: FloatArray, x: float, y: float, force: float) -> float:
    """Return the level at a normalised point.

    Parameters
    ----------
    parameters
        `TextureModel.kernel_parameters`, with a table.
    x, y
        Velocity; without headings, the speed and zero.
    force
        Normalised, as x and y.
    """
    headings, speeds = int(parameters[TABLE_SIZES]), int(parameters[TABLE_SIZES + 1])
    forces = int(parameters[TABLE_SIZES + 2])
    speed = np.sqrt(x * x + y * y)
    fall = min(speed / SLOWEST, 1.0) * min(force / SLOWEST, 1.0)
    if fall <= 0.0:
        return 0.0
    across = (np.log(max(speed, SLOWEST) + NEAR_REST) - _LOWEST) * _PER_LOGARITHM * (speeds - 1)
    along = (np.log(max(force, SLOWEST) + NEAR_REST) - _LOWEST) * _PER_LOGARITHM * (forces - 1)
    row, column = min(int(across), speeds - 2), min(int(along), forces - 2)
    across -= row
    along -= column
    turn, below, above = 0.0, 0, 0
    if headings > 1:
        turn = np.arctan2(y, x) * _PER_RADIAN
        turn = (turn - np.floor(turn)) * headings
        below = min(int(turn), headings - 1)
        turn -= below
        above = below + 1 if below + 1 < headings else 0
    value = 0.0
    for heading, share in ((below, 1.0 - turn), (above, turn)):
        place = TABLE + (heading * speeds + row) * forces + column
        lower = parameters[place] + along * (parameters[place + 1] - parameters[place])
        place += forces
        upper = parameters[place] + along * (parameters[place + 1] - parameters[place])
        value += share * (lower + across * (upper - lower))
    return float(np.exp(value) * fall)


@kernel(
    "void(f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1])"
)
def filters_into(
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    parameters: FloatArray,
    points: FloatArray,
    lsf: FloatArray,
    variance: FloatArray,
    power: FloatArray,
) -> None:
    """Write LSF (k, m), excitation variances (k,) and output powers (k,) at points (k, d).

    `rows`, `links` and `tail` are the interpolant's. Its level is the variance, unless a table
    gives powers: then the filter's gain converts them, as a mean of LSF has no mean of gains.
    """
    hint, work, values = 0, np.empty(SCRATCH), np.empty(1 + lsf.shape[1])
    for row in range(len(points)):
        hint = interpolate_into(rows, links, tail, hint, points[row], values, work)
        for k in range(lsf.shape[1]):
            lsf[row, k] = values[1 + k]
        inverse_gain = lsf_inverse_gain(lsf[row], work)
        variance[row], power[row] = values[0], values[0] / max(inverse_gain, TINY)
        if parameters[TABLE_SIZES] > 0.0:
            y = points[row, 1] if points.shape[1] == 3 else 0.0
            force = points[row, points.shape[1] - 1]
            power[row] = tabulated_level(parameters, points[row, 0], y, force)
            variance[row] = power[row] * inverse_gain if power[row] > 0.0 else 0.0
