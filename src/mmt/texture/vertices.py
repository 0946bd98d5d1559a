"""The points over which a texture model is triangulated: samples, merged, and boundary points."""

from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from mmt.arrays import FloatArray, IntArray

COINCIDENT: Final = 1e-6
"""Normalised distance below which two samples are one vertex, with their mean as value."""


def vertex_table(points: FloatArray, level: FloatArray, lsf: FloatArray) -> FloatArray:
    """Return x, y, level and LSF of samples and boundary points, shape (n + b, 3 + order).

    Coincident samples become one vertex with the mean of their filters (a convex
    combination of ordered LSF is ordered) and of their level. A boundary point copies its
    nearest sample; on the edges of zero speed and zero force its level is zero.

    Parameters
    ----------
    points
        Of the samples, in the unit square, shape (n, 2).
    level, lsf
        Of the samples, shapes (n,) and (n, order).
    """
    rows = np.column_stack([_on_edges(points), level, lsf])
    vertex = _coincident(rows[:, :2])
    counts = np.bincount(vertex)
    merged = np.zeros((len(counts), rows.shape[1]))
    np.add.at(merged, vertex, rows)
    merged /= counts[:, None]

    boundary = _boundary_points()
    offsets = boundary[:, None, :] - merged[None, :, :2]
    distance = np.hypot(offsets[..., 0], offsets[..., 1])
    extension = merged[distance.argmin(axis=1)]
    extension[:, :2] = boundary
    extension[(boundary == 0.0).any(axis=1), 2] = 0.0
    apart = distance.min(axis=1) > COINCIDENT
    return np.ascontiguousarray(np.vstack([merged, extension[apart]]))


def _boundary_points() -> FloatArray:
    """Return 20 points: positions 0, 1/5 ... 1 of each edge, corners shared; shape (20, 2)."""
    steps = np.arange(6) / 5
    edges = [(s, e) for s in steps for e in (0.0, 1.0)] + [
        (e, s) for s in steps[1:-1] for e in (0.0, 1.0)
    ]
    return np.array(edges)


def _on_edges(points: FloatArray) -> FloatArray:
    """Return the points (n, 2), those that all but lie on an edge moved onto it.

    Beside the edge they would leave triangles without area, or a plane that ends before it.
    """
    moved = np.where(points < COINCIDENT, 0.0, points)
    return np.where(moved > 1.0 - COINCIDENT, 1.0, moved)


def _coincident(points: FloatArray) -> IntArray:
    """Return the vertex, counted from 0, that each of the points (n, 2) is part of; (n,).

    Points closer than `COINCIDENT` have one vertex, those in cells of that width which touch
    each other may have: a chain of them is one vertex.
    """
    cells = np.round(points / COINCIDENT)
    cells, cell = np.unique(cells, axis=0, return_inverse=True)
    label = np.arange(len(cells))
    for pair in cKDTree(cells).query_pairs(1.5, p=np.inf, output_type="ndarray"):
        one, other = label[pair]
        label[label == max(one, other)] = min(one, other)
    _, vertex = np.unique(label[cell.reshape(-1)], return_inverse=True)
    return vertex.reshape(-1).astype(np.int64)
