"""The values of the nearest vertex: no interpolation at all, found by a scan. O(n) a point."""

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.texture.interpolation.interpolator import Evaluator, Interpolant, State
from mmt.texture.interpolation.vertices import Vertices


def build(vertices: Vertices, previous: Interpolant | None, state: State | None) -> Interpolant:
    """Keep the vertices as they are."""
    del previous, state
    return Interpolant(_copy_nearest, vertices.table)


@Evaluator
def _copy_nearest(
    rows: FloatArray,
    links: IntArray,  # noqa: ARG001
    tail: FloatArray,  # noqa: ARG001
    hint: int,  # noqa: ARG001
    point: FloatArray,
    values: FloatArray,
    scratch: FloatArray,  # noqa: ARG001
) -> int:
    """Copy the values of the row nearest to a point; return its number."""
    dimensions = len(point)
    nearest, least = 0, np.inf
    for row in range(rows.shape[0]):
        square = 0.0
        for k in range(dimensions):
            square += (rows[row, k] - point[k]) ** 2
        if square < least:
            nearest, least = row, square
    for k in range(len(values)):
        values[k] = rows[nearest, dimensions + k]
    return nearest
