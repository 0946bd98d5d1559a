"""The strokes over which an operator's error is judged, and how they fall into cells.

The part of the plane that evaluations compare: 40 to 260 mm/s and 0.4 to 2.6 N. Beyond lie
strokes that hardly any hand makes, or that hardly vibrate.
"""

from functools import cached_property
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.texture.completion.distance import DIVISIONS, cells_of
from mmt.texture.field.level_covariance import Features, nodes
from mmt.texture.model.inputs import ANISOTROPIC, ISOTROPIC, InputSpace

SPEEDS_MM_S: Final = (40.0, 260.0)
FORCES_N: Final = (0.4, 2.6)

_PLANAR_SHAPE: Final = (1, 12, 12)
_DIRECTED_SHAPE: Final = (12, 5, 5)
"""Headings, speeds and forces."""


class CompletionGrid:
    """Strokes, even in speed, force and heading.

    Parameters
    ----------
    space
        Of the model.

    Attributes
    ----------
    axes
        Logarithms of normalised speeds and forces, and headings.
    points
        The nodes, normalised, shape (g, d), in the order of `level_covariance.nodes`.
    """

    def __init__(self, space: InputSpace) -> None:
        headings, speeds, forces = _DIRECTED_SHAPE if space.directed else _PLANAR_SHAPE
        turn = np.linspace(0.0, 2.0 * np.pi, headings, endpoint=False) + np.pi / headings
        self.space = space
        self.axes = Features(
            np.log(np.linspace(*SPEEDS_MM_S, speeds) / space.maximum_speed_mm_s),
            np.log(np.linspace(*FORCES_N, forces) / space.maximum_force_n),
            turn if space.directed else 0.0 * turn,
        )
        self.nodes = at = nodes(self.axes)
        speed, force = np.exp(at.speed), np.exp(at.force)
        columns = [speed * np.cos(at.heading), speed * np.sin(at.heading), force]
        self.points: FloatArray = np.column_stack(columns if space.directed else [speed, force])

    def __len__(self) -> int:
        return len(self.points)

    @property
    def inputs(self) -> FloatArray:
        """The nodes with units, shape (g, d)."""
        return self.points * self.space.scale

    @cached_property
    def cells(self) -> IntArray:
        """The cell of `completion.cells_of` in which each node lies, shape (g,)."""
        places = self.points.copy()
        if self.space.directed:
            places[:, :2] = 0.5 * (places[:, :2] + 1.0)
        steps = np.clip((places * DIVISIONS).astype(np.int64), 0, DIVISIONS - 1)
        strides = DIVISIONS ** np.arange(self.space.dimensions)
        return np.asarray(steps @ strides)

    def mean_of_cells(self, values: FloatArray) -> FloatArray:
        """Return the mean of the nodes' values (g,) in each cell, shape (c,)."""
        count = len(cells_of(self.space.dimensions).centres)
        total = np.bincount(self.cells, values, minlength=count)
        return np.asarray(total / np.bincount(self.cells, minlength=count))


def completion_grid(dimensions: int) -> CompletionGrid:
    """Return the grid of the space of 2 or 3 inputs."""
    return CompletionGrid(ISOTROPIC if dimensions == 2 else ANISOTROPIC)
