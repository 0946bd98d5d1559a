"""Piecewise linear interpolation over a Delaunay triangulation, in two and three dimensions.

The points are normalised inputs, see `mmt.texture.model.inputs`. A point is located by a walk
from the simplex (triangle or tetrahedron) of the last one towards the corner with the least
weight: a hand moves continuously, so that a step or two suffices; a scan over all simplices
follows where the walk does not settle. A visibility walk in a Delaunay triangulation does not run
in circles (Devillers et al., Walking in a Triangulation, 2002). Weights are barycentric, clipped
to be non-negative and to sum to one, so that an interpolated value never leaves the range of its
corners. The kernels for tetrahedra are in `mmt.texture.interpolation.tetrahedra`: one for both
would be slower by a third in the plane.

Building costs O(n log n) (Qhull); locating costs O(1) for a continuous motion.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.split import separate
from mmt.texture.interpolation.tetrahedra import locate_3d, locate_many_3d

_TOLERANCE = 1e-12
_FLAT = 1e-12


@dataclass(frozen=True)
class Triangulation:
    """A triangulated point set, ready for compiled point location.

    Attributes
    ----------
    points
        Normalised coordinates, shape (n, d), d 2 or 3.
    triangles
        Shape (t, 2 (d + 1)): the corners of each triangle or tetrahedron, then the one
        opposite each corner (-1 where there is none).
    """

    points: FloatArray
    triangles: IntArray

    def weights(self, queries: FloatArray) -> tuple[IntArray, FloatArray]:
        """Locate points; return corners (k, d + 1) and barycentric weights (k, d + 1).

        Parameters
        ----------
        queries
            Normalised coordinates, shape (k, d); clipped to the box around the points.
        """
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        located = np.ascontiguousarray(np.clip(queries, low, high), dtype=np.float64)
        corners = np.empty((len(located), located.shape[1] + 1), dtype=np.int64)
        weights = np.empty(corners.shape)
        locate_each = locate_many if located.shape[1] == 2 else locate_many_3d
        locate_each(self.points, self.triangles, located, corners, weights)
        return corners, weights


def triangulate(points: FloatArray) -> Triangulation:
    """Triangulate distinct points that span the plane, or space.

    Tetrahedra without volume, which Qhull makes of points on one circle, are left out.

    Parameters
    ----------
    points
        Shape (n, d), finite, d 2 or 3, not all on one line or plane.
    """
    delaunay = Delaunay(points)
    corners = delaunay.simplices.astype(np.int64)
    opposite = delaunay.neighbors.astype(np.int64)
    if points.shape[1] == 3:
        corners, opposite = _without_flat(points, corners, opposite)
    return Triangulation(
        points=np.ascontiguousarray(points, dtype=np.float64),
        triangles=np.ascontiguousarray(np.hstack([corners, opposite])),
    )


def _without_flat(
    points: FloatArray, corners: IntArray, opposite: IntArray
) -> tuple[IntArray, IntArray]:
    """Return corners and opposites without flat tetrahedra, whose place becomes the outside."""
    edges = points[corners[:, 1:]] - points[corners[:, :1]]
    kept = np.abs(np.linalg.det(edges)) > _FLAT
    number = np.where(kept, np.cumsum(kept) - 1, -1)
    return corners[kept], np.where(opposite >= 0, number[opposite], -1)[kept]


@kernel("b1(f8[:, ::1], i8[:, ::1], i8, f8, f8, f8[::1])")
def barycentric(
    points: FloatArray,
    triangles: IntArray,
    triangle: int,
    x: float,
    y: float,
    weights: FloatArray,
) -> bool:
    """Write the weights of (x, y) in a triangle; false where the triangle has no area.

    Twice the signed area is computed from edges relative to one corner, so that its
    rounding error is relative to the triangle and not to the plane. `points` may have
    further columns; only the first two are read.
    """
    a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
    bx, by = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    cx, cy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
    area = bx * cy - by * cx
    if abs(area) <= 1e-15:
        return False
    px, py = x - points[a, 0], y - points[a, 1]
    weights[1] = (px * cy - py * cx) / area
    weights[2] = (bx * py - by * px) / area
    weights[0] = 1.0 - weights[1] - weights[2]
    return True


@kernel("i8(f8[:, ::1], i8[:, ::1], f8, f8, f8[::1])")
def _scan(points: FloatArray, triangles: IntArray, x: float, y: float, weights: FloatArray) -> int:
    best, best_least = 0, -np.inf
    for triangle in range(triangles.shape[0]):
        if barycentric(points, triangles, triangle, x, y, weights):
            least = min(weights[0], weights[1], weights[2])
            if least > best_least:
                best, best_least = triangle, least
    barycentric(points, triangles, best, x, y, weights)
    return best


@kernel("i8(f8[:, ::1], i8[:, ::1], i8, f8, f8, f8[::1])")
def locate(
    points: FloatArray,
    triangles: IntArray,
    start: int,
    x: float,
    y: float,
    weights: FloatArray,
) -> int:
    """Return the triangle that holds (x, y) and write its clipped barycentric weights.

    Parameters
    ----------
    points
        Shape (n, 2 or more); the first two columns are coordinates.
    triangles
        Shape (t, 6), see `Triangulation`.
    start
        The triangle to walk from; any integer.
    x, y
        A point of the unit square.
    weights
        Shape (3,), written.
    """
    count = triangles.shape[0]
    triangle = start if 0 <= start < count else 0
    found = False
    for _ in range(count + 1):
        if not barycentric(points, triangles, triangle, x, y, weights):
            break
        least = 0
        if weights[1] < weights[least]:
            least = 1
        if weights[2] < weights[least]:
            least = 2
        if weights[least] >= -_TOLERANCE:
            found = True
            break
        opposite = triangles[triangle, 3 + least]
        if opposite < 0:
            break
        triangle = opposite
    if not found:
        triangle = _scan(points, triangles, x, y, weights)
    total = 0.0
    for corner in range(3):
        weights[corner] = max(weights[corner], 0.0)
        total += weights[corner]
    for corner in range(3):
        weights[corner] /= total
    return triangle


@kernel("void(f8[:, ::1], i8[:, ::1], f8[:, ::1], i8[:, ::1], f8[:, ::1])")
def locate_many(
    points: FloatArray,
    triangles: IntArray,
    queries: FloatArray,
    corners: IntArray,
    weights: FloatArray,
) -> None:
    """Locate queries (k, 2) one after the other; write corners (k, 3) and weights (k, 3)."""
    triangle = 0
    for index in range(queries.shape[0]):
        triangle = locate(
            points, triangles, triangle, queries[index, 0], queries[index, 1], weights[index]
        )
        for corner in range(3):
            corners[index, corner] = triangles[triangle, corner]


@kernel("b1(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1])")
def _mean_of_three(
    rows: FloatArray, links: IntArray, found: int, weights: FloatArray, values: FloatArray
) -> bool:
    """Write a triangle's mean; say whether its frequencies ascend."""
    a, b, c = links[found, 0], links[found, 1], links[found, 2]
    of_a, of_b, of_c = weights[0], weights[1], weights[2]
    before, apart = 0.0, True
    values[0] = of_a * rows[a, 2] + of_b * rows[b, 2] + of_c * rows[c, 2]
    for k in range(1, len(values)):
        value = of_a * rows[a, 2 + k] + of_b * rows[b, 2 + k] + of_c * rows[c, 2 + k]
        apart = apart and before < value < np.pi
        values[k] = before = value
    return apart


@kernel("b1(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1])")
def _mean_of_four(
    rows: FloatArray, links: IntArray, found: int, weights: FloatArray, values: FloatArray
) -> bool:
    """Write a tetrahedron's mean; say whether its frequencies ascend."""
    a, b, c, d = links[found, 0], links[found, 1], links[found, 2], links[found, 3]
    of_a, of_b, of_c, of_d = weights[0], weights[1], weights[2], weights[3]
    before, apart = 0.0, True
    for k in range(len(values)):
        value = of_a * rows[a, 3 + k] + of_b * rows[b, 3 + k]
        value += of_c * rows[c, 3 + k] + of_d * rows[d, 3 + k]
        values[k] = value
        if k > 0:
            apart = apart and before < value < np.pi
            before = value
    return apart


@kernel("i8(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1], f8[::1])")
def linear_into(
    rows: FloatArray,
    links: IntArray,
    hint: int,
    point: FloatArray,
    values: FloatArray,
    scratch: FloatArray,
) -> int:
    """Write the mean of a simplex' corners by their weights; return the simplex."""
    if len(point) == 2:
        found = locate(rows, links, hint, point[0], point[1], scratch)
        apart = _mean_of_three(rows, links, found, scratch, values)
    else:
        found = locate_3d(rows, links, hint, point, scratch)
        apart = _mean_of_four(rows, links, found, scratch, values)
    if not apart:  # rounding has let frequencies meet
        separate(values[1:])
    return found
