"""How blocks of one stroke scatter: each for itself, and alike where they were made together.

The variogram of the blocks' log powers, within cells of equal strokes, over the distance between
the places (Cressie, Statistics for Spatial Data, 1993, section 2.4): half the mean square of the
difference of two blocks. At no distance it is the *nugget*, the variance of a single block about
what its place has in common: the scatter of a short time's power, wider on a surface that is felt
in bursts. What it gains over `FAR_MM` is the *sill*: the variance of what a place has in common,
a patch of the surface.

Both are drawn to those of a homogeneous surface by `PRIOR_BLOCKS` blocks. Cost: O(r) for r rows.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.texture.field.cells import FieldCells

NUGGET: Final = 0.15
"""Variance of a block's log power, nepers^2, on a homogeneous surface: some 13 independent samples
of 50, as on the development half of HaTT's models."""

SILL: Final = 0.01
"""Least variance between places, nepers^2: no surface is the same everywhere."""

PATCH_MM: Final = 20.0
"""Distance over which places become unlike each other, where they do: about a fingertip."""

FAR_MM: Final = 15.0
PRIOR_BLOCKS: Final = 6.0
_COMPARED: Final = 16
_HASH: Final = 7919


class Scatter(NamedTuple):
    """Variances relative to the power: of single blocks, and between places."""

    block: float
    place: float


def scatter(cells: FieldCells) -> Scatter:
    """Estimate the scatter of a surface's blocks.

    Returns
    -------
    scatter
        As relative variances of the power itself, for a log-normal scatter: exp(variance) - 1.
    """
    near, near_weight = _within_rows(cells)
    far, far_weight = _between_rows(cells)
    nugget = (near + PRIOR_BLOCKS * NUGGET) / (near_weight + PRIOR_BLOCKS)
    total = (far + PRIOR_BLOCKS * nugget) / (far_weight + PRIOR_BLOCKS)
    sill = max(total - nugget, 0.0) + SILL
    return Scatter(float(np.expm1(min(nugget, 3.0))), float(np.expm1(min(sill, 3.0))))


def _within_rows(cells: FieldCells) -> tuple[float, float]:
    """Return the squares about their means of blocks of one stroke and place, and their degrees."""
    count, _, first, second = cells.sums.T
    squares = np.maximum(second - np.square(first) / count, 0.0)
    return float(squares.sum()), float(np.maximum(count - 1.0, 0.0).sum())


def _between_rows(cells: FieldCells) -> tuple[float, float]:
    """Return the sum of half the squared differences of blocks at far places, and its weight.

    A row is compared with the next `_COMPARED` of its cell, in an order that has nothing to do
    with where they lie. A cell weighs as much as it has rows, less one.
    """
    count, _, first, second = cells.sums.T
    mean = first / count
    spread = np.maximum(second / count - np.square(mean), 0.0)
    places, place_of_row = cells.places_mm
    order = np.lexsort(((place_of_row * _HASH) % 1021, cells.cell_of_row))
    cell = cells.cell_of_row[order]
    mean, spread, count, at = mean[order], spread[order], count[order], places[place_of_row[order]]
    size = int(cell.max(initial=-1)) + 1
    total, weight = np.zeros(size), np.zeros(size)
    for lag in range(1, min(_COMPARED, len(cell) - 1) + 1):
        apart = np.hypot(*(at[lag:] - at[:-lag]).T)
        pairs = np.where(cell[lag:] == cell[:-lag], count[lag:] * count[:-lag], 0.0)
        pairs[apart < FAR_MM] = 0.0
        half = 0.5 * (np.square(mean[lag:] - mean[:-lag]) + spread[lag:] + spread[:-lag])
        total += np.bincount(cell[lag:], pairs * half, minlength=size)
        weight += np.bincount(cell[lag:], pairs, minlength=size)
    known = weight > 0.0
    degrees = np.bincount(cell, minlength=size)[known] - 1.0
    return float(degrees @ (total[known] / weight[known])), float(degrees.sum())
