"""The points over which a texture model is interpolated: merged samples, and boundary points.

Boundary points make the interpolation cover all that a hand can reach. In the plane of speed and
force they lie on the four edges (paper A, section V.B); around the cylinder of velocity vector and
force on its faces and beside its wall.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from mmt.core.arrays import FloatArray, IntArray

COINCIDENT: Final = 1e-6
"""Normalised distance below which two samples are one vertex, with their mean as value."""

HEADINGS: Final = 12
"""Points of a ring around the wall; each ring is turned by half a step against the last."""

LEVELS_OF_FORCE: Final = 4
"""Rings: at no force, one third, two thirds and all of the largest force."""

FACE_POINTS: Final = 16
"""Points inside either face, on a spiral that has no two of them at the same distance."""

RIM: Final = 1.0 / math.cos(math.pi / HEADINGS)
"""Radius of a ring: its polygon encloses the circle of the largest speed."""

_FACE_RADIUS: Final = 0.85
_GOLDEN_ANGLE: Final = math.pi * (3.0 - math.sqrt(5.0))


class Vertices(NamedTuple):
    """Points with values: samples, then boundary points.

    Attributes
    ----------
    table
        Points, level and LSF side by side, shape (n + b, d + 1 + order).
    dimensions
        How many columns are coordinates, d: 2 or 3.
    samples
        How many of the points, the first n, are samples; the others are the boundary.
    """

    table: FloatArray
    dimensions: int
    samples: int

    @property
    def points(self) -> FloatArray:
        """Normalised, shape (n + b, d)."""
        return self.table[:, : self.dimensions]

    @property
    def values(self) -> FloatArray:
        """Level and line spectral frequencies, shape (n + b, 1 + order)."""
        return self.table[:, self.dimensions :]


def vertex_table(points: FloatArray, level: FloatArray, lsf: FloatArray) -> Vertices:
    """Return points, level and LSF of samples and boundary points.

    Coincident samples become one vertex with the mean of their filters (a convex
    combination of ordered LSF is ordered) and of their level. A boundary point copies its
    nearest sample, except for the LSF if its own are given. On the edges of zero speed and zero
    force its level is zero. Over velocity and force, the level table makes a hand at rest feel
    nothing: see `mmt.texture.interpolation.interpolant`.

    Parameters
    ----------
    points
        Points of the samples, normalised, shape (n, d).
    level, lsf
        Level and LSF of the samples, shapes (n,) and (n, order); or (n + b, order) if those of
        all points of `boundary` follow.
    """
    count, dimensions = points.shape
    rows = np.column_stack([_on_edges(points), level, lsf[:count]])
    vertex = _coincident(rows[:, :dimensions])
    counts = np.bincount(vertex)
    merged = np.zeros((len(counts), rows.shape[1]))
    np.add.at(merged, vertex, rows)
    merged /= counts[:, None]

    around = boundary(dimensions)
    distance = cdist(around, merged[:, :dimensions])
    extension = merged[distance.argmin(axis=1)]
    extension[:, :dimensions] = around
    if dimensions == 2:
        extension[(around == 0.0).any(axis=1), dimensions] = 0.0
    if len(lsf) > count:
        extension[:, dimensions + 1 :] = lsf[count:]
    apart = distance.min(axis=1) > COINCIDENT
    table = np.ascontiguousarray(np.vstack([merged, extension[apart]]))
    return Vertices(table, dimensions, len(merged))


def _on_edges(points: FloatArray) -> FloatArray:
    """Return the points (n, d); those within `COINCIDENT` of an edge are moved onto it.

    Points just beside an edge would leave triangles without area, or end the plane before the
    edge. A velocity has no edge: the boundary lies beyond the largest speed.
    """
    bounded = points if points.shape[1] == 2 else points[:, 2:]
    moved = np.where(bounded < COINCIDENT, 0.0, bounded)
    moved = np.where(moved > 1.0 - COINCIDENT, 1.0, moved)
    return moved if points.shape[1] == 2 else np.hstack([points[:, :2], moved])


def _coincident(points: FloatArray) -> IntArray:
    """Return the number of the vertex, from 0, of each of the points (n, d); (n,).

    Points closer than `COINCIDENT` share a vertex. So do all points in cells of that width which
    touch each other: a chain of cells is one vertex.
    """
    cells = np.round(points / COINCIDENT)
    cells, cell = np.unique(cells, axis=0, return_inverse=True)
    label = np.arange(len(cells))
    for pair in cKDTree(cells).query_pairs(1.5, p=np.inf, output_type="ndarray"):
        one, other = label[pair]
        label[label == max(one, other)] = min(one, other)
    _, vertex = np.unique(label[cell.reshape(-1)], return_inverse=True)
    return vertex.reshape(-1).astype(np.int64)


def boundary(dimensions: int) -> FloatArray:
    """Return the boundary points (b, d) of the space of 2 or 3 inputs.

    In the plane 20 points: positions 0, 1/5 ... 1 of each edge, corners shared. Around the cylinder
    80 points: rings, and points inside the faces.
    """
    if dimensions == 2:
        steps, ends = np.arange(6) / 5, (0.0, 1.0)
        edges = [(s, e) for s in steps for e in ends] + [(e, s) for s in steps[1:-1] for e in ends]
        return np.array(edges)
    headings = np.linspace(0.0, 2.0 * np.pi, HEADINGS, endpoint=False)
    rings = [
        _at(RIM, headings + (number % 2) * np.pi / HEADINGS, number / (LEVELS_OF_FORCE - 1))
        for number in range(LEVELS_OF_FORCE)
    ]
    turn = np.arange(FACE_POINTS, dtype=np.float64)
    radius: FloatArray = _FACE_RADIUS * np.sqrt((turn + 0.5) / FACE_POINTS)
    faces = [_at(radius, turn * _GOLDEN_ANGLE, force) for force in (0.0, 1.0)]
    return np.vstack([*rings, *faces])


def _at(radius: float | FloatArray, heading: FloatArray, force: float | FloatArray) -> FloatArray:
    columns = radius * np.cos(heading), radius * np.sin(heading), force
    return np.stack(np.broadcast_arrays(*columns), axis=-1)
