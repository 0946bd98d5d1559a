"""Piecewise linear interpolation over a Delaunay triangulation, in two and three dimensions.

The points are normalised inputs, see `mmt.texture.space`. A point is located by a walk
from the simplex (triangle or tetrahedron) of the last point, each step away from the corner with
the least weight. A hand moves continuously, so that a step or two suffices. If the walk does not
settle, all simplices are scanned. A visibility walk in a Delaunay triangulation does not run in
circles (Devillers et al., Walking in a Triangulation, 2002). Weights are barycentric, clipped
to be non-negative and to sum to one, so that an interpolated value never leaves the range of its
corners.

Building costs O(n log n) (Qhull); locating costs O(1) for a continuous motion.
"""

from dataclasses import dataclass

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.split import separate

_TOLERANCE = 1e-12
_FLAT = 1e-12
_FLAT_AREA = 1e-15


@dataclass(frozen=True)
class Triangulation:
    """A triangulated point set, ready for compiled point location.

    Attributes
    ----------
    points
        Normalised coordinates, shape (n, d), d 2 or 3.
    triangles
        Shape (t, 2 (d + 1)): the corners of each triangle or tetrahedron, then the one
        opposite each corner (-1 if there is none).
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
        weights = np.empty((len(located), located.shape[1] + 1))
        found, simplex = np.empty(len(located), dtype=np.int64), 0
        for row, point in enumerate(located):
            simplex = locate(self.points, self.triangles, simplex, point, weights[row])
            found[row] = simplex
        return self.triangles[found, : weights.shape[1]], weights


def triangulate(points: FloatArray) -> Triangulation:
    """Triangulate distinct points that span the plane, or space.

    Tetrahedra without volume, which Qhull makes of points on one circle, are left out.

    Parameters
    ----------
    points
        Shape (n, d), finite, d 2 or 3, not all on one line or plane.
    """
    from scipy.spatial import Delaunay  # rendering takes no memory for it

    delaunay = Delaunay(points)
    corners = delaunay.simplices.astype(np.int64)
    opposite = delaunay.neighbors.astype(np.int64)
    if points.shape[1] == 3:  # neighbours of a flat one border on the outside
        edges = points[corners[:, 1:]] - points[corners[:, :1]]
        kept = np.abs(np.linalg.det(edges)) > _FLAT
        number = np.where(kept, np.cumsum(kept) - 1, -1)
        corners, opposite = corners[kept], np.where(opposite >= 0, number[opposite], -1)[kept]
    return Triangulation(
        points=np.ascontiguousarray(points, dtype=np.float64),
        triangles=np.ascontiguousarray(np.hstack([corners, opposite])),
    )


@kernel("b1(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1])", inner=True)
def barycentric(
    points: FloatArray, simplices: IntArray, simplex: int, point: FloatArray, weights: FloatArray
) -> bool:
    """Write the weights (d + 1,) of a point (d,) in a simplex; return False if it is flat.

    Areas and volumes are computed from edges relative to one corner, so that their rounding
    errors are relative to the simplex and not to the space. `points` may have further columns;
    only the first d are read.
    """
    a, b, c = simplices[simplex, 0], simplices[simplex, 1], simplices[simplex, 2]
    ax, ay = points[a, 0], points[a, 1]
    bx, by, cx, cy = points[b, 0] - ax, points[b, 1] - ay, points[c, 0] - ax, points[c, 1] - ay
    px, py = point[0] - ax, point[1] - ay
    if len(point) == 2:
        area = bx * cy - by * cx
        if abs(area) <= _FLAT_AREA:
            return False
        weights[1] = (px * cy - py * cx) / area
        weights[2] = (bx * py - by * px) / area
        weights[0] = 1.0 - weights[1] - weights[2]
        return True
    d, az = simplices[simplex, 3], points[a, 2]
    bz, cz, pz = points[b, 2] - az, points[c, 2] - az, point[2] - az
    dx, dy, dz = points[d, 0] - ax, points[d, 1] - ay, points[d, 2] - az
    ux, uy, uz = cy * dz - cz * dy, cz * dx - cx * dz, cx * dy - cy * dx
    volume = bx * ux + by * uy + bz * uz
    vx, vy, vz = py * bz - pz * by, pz * bx - px * bz, px * by - py * bx
    weights[1] = (px * ux + py * uy + pz * uz) / volume
    weights[2] = -(dx * vx + dy * vy + dz * vz) / volume
    weights[3] = (cx * vx + cy * vy + cz * vz) / volume
    weights[0] = 1.0 - weights[1] - weights[2] - weights[3]
    return True


@kernel("i8(f8[::1])", inner=True)
def _least(weights: FloatArray) -> int:
    least = 0
    for corner in range(1, len(weights)):
        if weights[corner] < weights[least]:
            least = corner
    return least


@kernel("i8(f8[:, ::1], i8[:, ::1], f8[::1], f8[::1])")
def _scan(points: FloatArray, simplices: IntArray, point: FloatArray, weights: FloatArray) -> int:
    best, best_least = 0, -np.inf
    for simplex in range(simplices.shape[0]):
        if barycentric(points, simplices, simplex, point, weights):
            least = weights[_least(weights)]
            if least > best_least:
                best, best_least = simplex, least
    barycentric(points, simplices, best, point, weights)
    return best


@kernel("i8(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1])")
def locate(
    points: FloatArray, simplices: IntArray, start: int, point: FloatArray, weights: FloatArray
) -> int:
    """Return the simplex that holds a point and write its clipped barycentric weights.

    Parameters
    ----------
    points
        Shape (n, d or more); the first d columns are coordinates.
    simplices
        Shape (t, 2 (d + 1)), see `Triangulation`.
    start
        The simplex to walk from; any integer.
    point
        Shape (d,), finite. Outside all simplices, the weights are those of a point on their edge.
    weights
        Shape (d + 1,), written: not negative, with sum one.
    """
    count, corners = simplices.shape[0], len(weights)
    simplex = start if 0 <= start < count else 0
    found = False
    for _ in range(count + 1):
        if not barycentric(points, simplices, simplex, point, weights):
            break
        least = _least(weights)
        if weights[least] >= -_TOLERANCE:
            found = True
            break
        opposite = simplices[simplex, corners + least]
        if opposite < 0:
            break
        simplex = opposite
    if not found:
        simplex = _scan(points, simplices, point, weights)
    total = 0.0
    for corner in range(corners):
        weights[corner] = max(weights[corner], 0.0)
        total += weights[corner]
    for corner in range(corners):
        weights[corner] /= total
    return simplex


@kernel("i8(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1], f8[::1])", inner=True)
def linear_into(
    rows: FloatArray,
    links: IntArray,
    hint: int,
    point: FloatArray,
    values: FloatArray,
    scratch: FloatArray,
) -> int:
    """Write the weighted mean of the corners of a point's simplex; return the simplex."""
    dimensions = len(point)
    weights = scratch[: dimensions + 1]
    found = locate(rows, links, hint, point, weights)
    values[:] = 0.0
    for corner in range(dimensions + 1):
        row, weight = links[found, corner], weights[corner]
        for k in range(len(values)):
            values[k] += weight * rows[row, dimensions + k]
    before, apart = 0.0, True
    for k in range(1, len(values)):
        apart = apart and before < values[k] < np.pi
        before = values[k]
    if not apart:  # rounding has let frequencies meet
        separate(values[1:])
    return found
