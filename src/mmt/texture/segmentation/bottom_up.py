"""Bottom-up segmentation: cells of samples, merged while the cheapest merge is allowed.

Keogh, Chu, Hart and Pazzani, "An online algorithm for segmenting time series" (ICDM 2001):
begin with the finest pieces and join the two neighbours whose union costs least, until every
union would cost more than the limit. Two costs serve the two stages of Abdulali and Jeon
(2016), which paper A follows: how far the path leaves its chord, and how much speed and force
vary relative to their means. If the heading counts, the velocity vector replaces the speed.

Merges are ordered by cost alone, ties from the left, so that the result in one place does not
depend on where the data begins.
"""

import math

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.core.compiled import kernel

CELL = 10
"""Samples of the finest piece, a cell. Cells begin at multiples of it in absolute sample number."""


def cell_moments(channels: FloatArray) -> FloatArray:
    """Return the mean and the sum of squared deviations of each channel in each cell.

    Parameters
    ----------
    channels
        Shape (cells * CELL, channels).

    Returns
    -------
    FloatArray
        Shape (cells, channels, 2).
    """
    cells = channels.reshape(-1, CELL, channels.shape[1])
    mean = cells.mean(axis=1)
    return np.stack([mean, ((cells - mean[:, None]) ** 2).sum(axis=1)], axis=2)


def straight_pieces(starts: BoolArray, position_mm: FloatArray, limit_mm: float) -> BoolArray:
    """Join cells to pieces of path that keep within a distance of their chord.

    Parameters
    ----------
    starts
        Shape (cells,): True where a piece has to begin, whatever the cost.
    position_mm
        Shape (cells * CELL, 3).
    limit_mm
        The maximal deviation tau_1.

    Returns
    -------
    BoolArray
        Shape (cells,): True where a piece begins.

    Notes
    -----
    Each merge costs O(cells); a stroke has hundreds of cells. A cost takes O(samples of the
    union): O(samples log cells) in all if merges double pieces, O(samples cells) at worst.
    """
    return _bottom_up(starts, position_mm, np.zeros((0, 0, 0)), 0, limit_mm, len(starts))


def stationary_pieces(
    starts: BoolArray, moments: FloatArray, limit: float, longest_cells: int, vector: int = 0
) -> BoolArray:
    """Join cells to pieces in which no channel's std/mean exceeds a limit.

    The last channels may form one vector; its std/mean is the root of the summed variances over
    the length of the mean.

    Parameters
    ----------
    starts
        As of `straight_pieces`.
    moments
        Shape (cells, channels, 2), from `cell_moments`. In cells that may be joined, means
        must be positive, except those of the vector.
    limit
        The maximal std/mean tau_2.
    longest_cells
        No piece becomes longer.
    vector
        How many of the last channels are components of a vector.

    Returns
    -------
    BoolArray
        As of `straight_pieces`.

    Notes
    -----
    Each merge costs O(cells). Moments are joined pairwise (Chan, Golub and LeVeque 1983), which
    never subtracts large sums, so that a glitch does not reduce the accuracy nearby.
    """
    return _bottom_up(starts, np.zeros((0, 0)), moments.copy(), vector, limit, longest_cells)


@kernel("f8(f8[:, ::1], i8, i8)", inner=True)
def _deviation(position_mm: FloatArray, start: int, stop: int) -> float:
    """Return the largest distance from the chord between the first and the last position."""
    chord = np.empty(3)
    length2 = 0.0
    for k in range(3):
        chord[k] = position_mm[stop - 1, k] - position_mm[start, k]
        length2 += chord[k] * chord[k]
    largest = 0.0
    for n in range(start, stop):
        along = 0.0
        for k in range(3):
            along += (position_mm[n, k] - position_mm[start, k]) * chord[k]
        # Beyond the ends the distance is that to the end: a path that turns back is not straight.
        share = min(max(along / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
        distance2 = 0.0
        for k in range(3):
            distance2 += (position_mm[n, k] - position_mm[start, k] - share * chord[k]) ** 2
        largest = np.maximum(largest, distance2)
    return math.sqrt(largest)


@kernel("f8(f8[:, :, ::1], i8, i8, i8, i8)", inner=True)
def _variation(moments: FloatArray, vector: int, left: int, right: int, stop: int) -> float:
    """Return the largest std/mean of the union of the pieces at cells `left` and `right`."""
    n_left, n_right = float(right - left), float(stop - right)
    n = n_left + n_right
    largest = all_squares = length2 = 0.0
    for k in range(moments.shape[1]):
        step = moments[right, k, 0] - moments[left, k, 0]
        squares = moments[left, k, 1] + moments[right, k, 1]
        squares += step * step * CELL * n_left * n_right / n
        mean = moments[left, k, 0] + step * n_right / n
        if k < moments.shape[1] - vector:
            largest = np.maximum(largest, math.sqrt(squares / (CELL * n)) / mean)
        else:
            all_squares += squares
            length2 += mean * mean
    if vector > 0:
        largest = np.maximum(largest, math.sqrt(all_squares / (CELL * n) / length2))
    return largest


@kernel("void(f8[:, :, ::1], i8, i8, i8)", inner=True)
def _join(moments: FloatArray, left: int, right: int, stop: int) -> None:
    """Put the moments of the union of the pieces at `left` and `right` at `left`."""
    n_left, n_right = float(right - left), float(stop - right)
    n = n_left + n_right
    for k in range(moments.shape[1]):
        step = moments[right, k, 0] - moments[left, k, 0]
        moments[left, k, 1] += moments[right, k, 1] + step * step * CELL * n_left * n_right / n
        moments[left, k, 0] += step * n_right / n


@kernel("b1[::1](b1[::1], f8[:, ::1], f8[:, :, ::1], i8, f8, i8)")
def _bottom_up(
    starts: BoolArray,
    position_mm: FloatArray,
    moments: FloatArray,
    vector: int,
    limit: float,
    longest_cells: int,
) -> BoolArray:
    """Merge neighbours by least cost, that of the path if there are no moments.

    A piece is indexed by its first cell. Moments are overwritten.
    """
    cells = starts.size
    straight = moments.shape[0] == 0
    begins = np.ones(cells, np.bool_)
    stop, before = np.empty(cells, np.int64), np.empty(cells, np.int64)
    changed, count = np.empty(max(cells, 2), np.int64), cells
    for cell in range(cells):  # np.arange takes the compiler a third of a second
        stop[cell], before[cell], changed[cell] = cell + 1, cell - 1, cell
    costs = np.full(cells + 1, np.inf)  # of joining the piece at a cell with the next one
    while True:
        for left in changed[:count]:
            if left < 0:
                continue
            cost = np.inf
            right = stop[left]
            if right < cells and not starts[right] and stop[right] - left <= longest_cells:
                if straight:
                    cost = _deviation(position_mm, left * CELL, stop[right] * CELL)
                else:
                    cost = _variation(moments, vector, left, right, stop[right])
            # A cost above the limit, or NaN, must never be chosen.
            costs[left] = cost if cost <= limit else np.inf
        left = 0
        for cell in range(1, cells):
            if costs[cell] < costs[left]:
                left = cell
        if costs[left] == np.inf:
            return begins
        right = stop[left]
        if not straight:
            _join(moments, left, right, stop[right])
        begins[right] = False
        stop[left] = stop[right]
        if stop[left] < cells:
            before[stop[left]] = left
        costs[right] = np.inf
        changed[0], changed[1], count = before[left], left, 2
