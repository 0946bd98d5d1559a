"""Completion by distance: how densely samples cover the input space of a model.

Awan et al., Model-Mediated Teleoperation for Remote Haptic Texture Sharing, section V.C and
eq. (1). The plane, normalised by its maxima, is cut into 3 x 3 equal rectangles; for each
centre the distances to the three nearest samples are added. Boundary points never count.

With the heading as well, every axis is cut in three again, velocity from -300 to 300 mm/s:
27 boxes. Only the reachable part of each box counts, at most 300 mm/s in any direction, and its
centre is that of this part. The distances to four neighbours are summed, as it takes four points
to enclose a point in space and three in the plane.

Eq. (1) asks for a mean distance of a third of a cell's diagonal: a sum of 4.243 in the plane, and
by the same rule 36 in space. Rendering starts at 7.5 (section V.C, about ten samples). Distances
among n samples are proportional to ``n^(-1/d)``: 7.5 takes 0.32 of the samples that 4.243 takes,
which gives 52.63 in space. These are `mmt.texture.settings.DISTANCES`.
"""

import math
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.completion.criterion import Criterion, Progress
from mmt.texture.settings import MAXIMUM_FORCE_N, MAXIMUM_SPEED_MM_S, ModellingSettings
from mmt.texture.space import InputSpace

DIVISIONS: Final = 3
NEIGHBOURS: Final = 3

CELL_CENTRES: Final[FloatArray] = np.array(
    [((x + 0.5) / DIVISIONS, (y + 0.5) / DIVISIONS) for y, x in product(range(DIVISIONS), repeat=2)]
)
"""Normalised (speed, force) of the nine centres, shape (9, 2)."""

SPEED_RANGE_MM_S: Final = (ModellingSettings.least_speed_mm_s, MAXIMUM_SPEED_MM_S)
FORCE_RANGE_N: Final = (ModellingSettings.least_force_n, MAXIMUM_FORCE_N)
"""Ranges over which models are scored and shares expected: from the least speed and force that are
modelled to the largest."""

_QUADRATURE: Final = 200


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells of an input space.

    Attributes
    ----------
    centres
        Normalised centres, shape (c, d).
    neighbours
        Number of nearest samples whose distances are summed at each centre.
    farthest
        The largest distance within the space, which stands in for a missing neighbour: so the sum
        is defined for any number of samples, and an added sample can only lower it.
    """

    centres: FloatArray
    neighbours: int
    farthest: float


def reachable_centres() -> FloatArray:
    """Return the centres (27, 3) of the part of each box inside the cylinder of speeds."""
    fine = (np.arange(_QUADRATURE) + 0.5) / _QUADRATURE
    rows = []
    for force, row, column in product(range(DIVISIONS), repeat=3):
        x, y = np.meshgrid(*(2.0 * (place + fine) / DIVISIONS - 1.0 for place in (column, row)))
        inside = np.hypot(x, y) <= 1.0
        rows.append((x[inside].mean(), y[inside].mean(), (force + 0.5) / DIVISIONS))
    return np.array(rows)


@cache
def cells_of(dimensions: int) -> Cells:
    """Return the cells of the space of 2 or 3 inputs; those of 3 take 20 ms."""
    if dimensions == 2:
        return Cells(CELL_CENTRES, NEIGHBOURS, math.sqrt(2.0))
    return Cells(reachable_centres(), NEIGHBOURS + 1, math.hypot(2.0, 1.0))


def cell_distances(points: FloatArray) -> FloatArray:
    """Return, for each cell, the summed distance to the nearest samples.

    Parameters
    ----------
    points
        Normalised inputs of the samples, shape (n, d), without boundary points.

    Returns
    -------
    FloatArray
        Shape (c,), in the order of the cells' centres. O(n).
    """
    cells = cells_of(points.shape[1])
    missing = np.full((len(cells.centres), cells.neighbours), cells.farthest)
    squares = np.square(points - cells.centres[:, np.newaxis]).sum(axis=2)
    nearest = np.partition(np.hstack([np.sqrt(squares), missing]), cells.neighbours - 1, axis=1)
    return np.asarray(np.sort(nearest[:, : cells.neighbours], axis=1).sum(axis=1))


def distance_sum(points: FloatArray) -> float:
    """Return the completion sum over the cells; see `cell_distances`."""
    return float(cell_distances(points).sum())


class CompletionMonitor(Criterion):
    """Completion criterion on the sum of distances.

    Parameters
    ----------
    settings
        Modelling settings: inputs and thresholds.
    """

    def __init__(self, settings: ModellingSettings) -> None:
        super().__init__(settings.scale)
        self._space = InputSpace(settings.inputs)
        self.progress = self._at(np.empty((0, self._space.dimensions)))

    def update(self, points: FloatArray, time_s: float) -> None:
        """Evaluate normalised samples (n, d) of a model at a session time in seconds."""
        self.progress = self._at(points)
        self.record_value(self.progress.value, time_s)

    def _at(self, points: FloatArray) -> Progress:
        distances = cell_distances(points)
        centres = cells_of(self._space.dimensions).centres * self._space.scale
        return Progress(
            scale=self.scale,
            value=float(distances.sum()),
            cells=tuple(distances.tolist()),
            advice=tuple(centres[int(np.argmax(distances))].tolist()) if len(points) else None,
        )


def middles(ends: tuple[float, float], count: int) -> FloatArray:
    """Return the middles of `count` equal parts of a range, shape (count,)."""
    low, high = ends
    return low + (high - low) * (np.arange(count) + 0.5) / count
