"""When is a model complete: distances in the speed-force plane.

Awan et al., Model-Mediated Teleoperation for Remote Haptic Texture Sharing, section V.C and
eq. (1). The plane, normalised by its maxima, is cut into 3 x 3 equal rectangles; for each
centre the distances to the three nearest samples are added. Boundary points never count.
"""

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from mmt.arrays import FloatArray

DIVISIONS: Final = 3
NEIGHBOURS: Final = 3

STOP_DISTANCE: Final = (
    DIVISIONS**2 * NEIGHBOURS * math.hypot(1 / DIVISIONS, 1 / DIVISIONS) / NEIGHBOURS
)
"""Eq. (1): 4.243; modelling ends here."""

START_DISTANCE: Final = 7.5
"""Section V.C: rendering from the model may start here (about ten samples)."""

FARTHEST: Final = math.sqrt(2.0)
"""The plane's diagonal stands in for a neighbour that does not exist yet, so that the sum is
defined for any number of samples and an added sample can only lower it."""

CELL_CENTRES: Final[FloatArray] = np.array(
    [
        ((column + 0.5) / DIVISIONS, (row + 0.5) / DIVISIONS)
        for row in range(DIVISIONS)
        for column in range(DIVISIONS)
    ]
)
"""Normalised (speed, force) of the nine centres, shape (9, 2)."""


def cell_distances(points: FloatArray) -> FloatArray:
    """Return, for each of the nine cells, the summed distance to the three nearest samples.

    Parameters
    ----------
    points
        Normalised (speed, force) of the samples, shape (n, 2), without boundary points.

    Returns
    -------
    FloatArray
        Shape (9,), in the order of `CELL_CENTRES`. O(n).
    """
    missing = max(0, NEIGHBOURS - len(points))
    distances = np.full((len(CELL_CENTRES), len(points) + missing), FARTHEST)
    if len(points):
        offsets = CELL_CENTRES[:, None, :] - np.asarray(points)[None, :, :]
        distances[:, : len(points)] = np.hypot(offsets[..., 0], offsets[..., 1])
    nearest = np.partition(distances, NEIGHBOURS - 1, axis=1)[:, :NEIGHBOURS]
    return np.asarray(nearest.sum(axis=1))


def distance_sum(points: FloatArray) -> float:
    """Return the completion sum over the nine cells; see `cell_distances`."""
    return float(cell_distances(points).sum())


@dataclass
class CompletionMonitor:
    """Remember which of the two criteria the model has met.

    Attributes
    ----------
    start_distance, stop_distance
        Thresholds on `distance_sum`.
    distance
        The newest sum.
    start_s, stop_s
        The session time at which each criterion was first met, None before.
    """

    start_distance: float = START_DISTANCE
    stop_distance: float = STOP_DISTANCE
    distance: float = field(default=len(CELL_CENTRES) * NEIGHBOURS * FARTHEST, init=False)
    start_s: float | None = field(default=None, init=False)
    stop_s: float | None = field(default=None, init=False)

    def update(self, points: FloatArray, time_s: float) -> None:
        """Take the samples (n, 2) of the model at a session time in seconds."""
        self.distance = distance_sum(points)
        if self.start_s is None and self.distance <= self.start_distance:
            self.start_s = time_s
        if self.stop_s is None and self.distance <= self.stop_distance:
            self.stop_s = time_s

    @property
    def started(self) -> bool:
        """Whether rendering from the model may start."""
        return self.start_s is not None

    @property
    def stopped(self) -> bool:
        """Whether modelling is to end."""
        return self.stop_s is not None
