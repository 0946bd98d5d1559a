"""Piecewise linear interpolation over a Delaunay triangulation, in two and three dimensions.

The points are normalised inputs, see `mmt.texture.model.inputs`. A point is located by a walk
from the simplex (triangle or tetrahedron) of the last one towards the corner with the least
weight: a hand moves continuously, so that a step or two suffices; a scan over all simplices
follows where the walk does not settle. A visibility walk in a Delaunay triangulation does not run
in circles (Devillers et al., Walking in a Triangulation, 2002). Weights are barycentric, clipped
to be non-negative and to sum to one, so that an interpolated value never leaves the range of its
corners.

Building costs O(n log n) (Qhull); locating costs O(1) for a continuous motion.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.split import separate
from mmt.texture.interpolation.interpolator import Evaluator, Interpolant, State
from mmt.texture.interpolation.vertices import Vertices

_TOLERANCE = 1e-12
_FLAT = 1e-12


def build(vertices: Vertices, previous: Interpolant | None, state: State | None) -> Interpolant:
    """Triangulate anew, which costs O(n log n)."""
    del previous, state
    mesh = triangulate(vertices.points)
    return Interpolant(_interpolate_linearly, vertices.table, mesh.triangles)


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
        locate_many(self.points, self.triangles, located, corners, weights)
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
def _triangle_weights(
    points: FloatArray, triangles: IntArray, triangle: int, x: float, y: float, weights: FloatArray
) -> bool:
    """Write the weights (3,) of (x, y) in a triangle; false where the triangle has no area.

    Twice the signed area is computed from edges relative to one corner, so that its
    rounding error is relative to the triangle and not to the plane.
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


@kernel("void(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1])")
def _tetrahedron_weights(
    points: FloatArray,
    tetrahedra: IntArray,
    tetrahedron: int,
    point: FloatArray,
    weights: FloatArray,
) -> None:
    """Write the weights (4,) of a point (3,) in a tetrahedron that has a volume.

    Volumes are computed from edges relative to one corner, as areas are.
    """
    a, b = tetrahedra[tetrahedron, 0], tetrahedra[tetrahedron, 1]
    c, d = tetrahedra[tetrahedron, 2], tetrahedra[tetrahedron, 3]
    ax, ay, az = points[a, 0], points[a, 1], points[a, 2]
    bx, by, bz = points[b, 0] - ax, points[b, 1] - ay, points[b, 2] - az
    cx, cy, cz = points[c, 0] - ax, points[c, 1] - ay, points[c, 2] - az
    dx, dy, dz = points[d, 0] - ax, points[d, 1] - ay, points[d, 2] - az
    px, py, pz = point[0] - ax, point[1] - ay, point[2] - az
    ux, uy, uz = cy * dz - cz * dy, cz * dx - cx * dz, cx * dy - cy * dx
    volume = bx * ux + by * uy + bz * uz
    vx, vy, vz = py * bz - pz * by, pz * bx - px * bz, px * by - py * bx
    weights[1] = (px * ux + py * uy + pz * uz) / volume
    weights[2] = -(dx * vx + dy * vy + dz * vz) / volume
    weights[3] = (cx * vx + cy * vy + cz * vz) / volume
    weights[0] = 1.0 - weights[1] - weights[2] - weights[3]


@kernel("b1(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1])")
def _barycentric(
    points: FloatArray, simplices: IntArray, simplex: int, point: FloatArray, weights: FloatArray
) -> bool:
    """Write the weights (d + 1,) of a point (d,) in a simplex; false where it has no area."""
    if len(point) == 2:
        return _triangle_weights(points, simplices, simplex, point[0], point[1], weights)
    _tetrahedron_weights(points, simplices, simplex, point, weights)
    return True


@kernel("i8(f8[::1], i8)")
def _least(weights: FloatArray, corners: int) -> int:
    least = 0
    for corner in range(1, corners):
        if weights[corner] < weights[least]:
            least = corner
    return least


@kernel("i8(f8[:, ::1], i8[:, ::1], f8[::1], f8[::1])")
def _scan(points: FloatArray, simplices: IntArray, point: FloatArray, weights: FloatArray) -> int:
    best, best_least = 0, -np.inf
    for simplex in range(simplices.shape[0]):
        if _barycentric(points, simplices, simplex, point, weights):
            least = weights[_least(weights, len(point) + 1)]
            if least > best_least:
                best, best_least = simplex, least
    _barycentric(points, simplices, best, point, weights)
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
        Shape (d,), finite, d 2 or 3. Outside of them all it gets a point of their boundary.
    weights
        Shape (d + 1,) or longer; the first d + 1 are written, not negative and with sum one.
    """
    count, corners = simplices.shape[0], len(point) + 1
    simplex = start if 0 <= start < count else 0
    found = False
    for _ in range(count + 1):
        if not _barycentric(points, simplices, simplex, point, weights):
            break
        least = _least(weights, corners)
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


@kernel("void(f8[:, ::1], i8[:, ::1], f8[:, ::1], i8[:, ::1], f8[:, ::1])")
def locate_many(
    points: FloatArray,
    simplices: IntArray,
    queries: FloatArray,
    corners: IntArray,
    weights: FloatArray,
) -> None:
    """Locate queries (k, d) one after the other; write corners and weights (k, d + 1)."""
    simplex = 0
    for index in range(queries.shape[0]):
        simplex = locate(points, simplices, simplex, queries[index], weights[index])
        for corner in range(corners.shape[1]):
            corners[index, corner] = simplices[simplex, corner]


@Evaluator
def _interpolate_linearly(
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,  # noqa: ARG001
    hint: int,
    point: FloatArray,
    values: FloatArray,
    scratch: FloatArray,
) -> int:
    """Write the mean of a simplex' corners by their weights; return the simplex."""
    found, dimensions = locate(rows, links, hint, point, scratch), len(point)
    a, b, c, d = links[found, 0], links[found, 1], links[found, 2], links[found, dimensions]
    of_a, of_b, of_c, of_d = scratch[0], scratch[1], scratch[2], scratch[3]
    before, apart = 0.0, True
    for k in range(len(values)):
        column = dimensions + k
        value = of_a * rows[a, column] + of_b * rows[b, column]
        if dimensions == 2:
            value += of_c * rows[c, column]
        else:
            value += of_c * rows[c, column] + of_d * rows[d, column]
        values[k] = value
        if k > 0:
            apart = apart and before < value < np.pi
            before = value
    if not apart:  # rounding has let frequencies meet
        separate(values[1:])
    return found
