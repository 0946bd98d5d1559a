"""Point location among the tetrahedra of a Delaunay triangulation, compiled.

The same walk as among triangles (`mmt.texture.interpolation.delaunay`): from the tetrahedron of the
last point towards the corner with the least weight, and a scan over all of them where the
walk does not settle. A visibility walk in a Delaunay triangulation does not run in circles
(Devillers et al., Walking in a Triangulation, 2002).
"""

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel

_TOLERANCE = 1e-12


@kernel("void(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1])")
def barycentric_3d(
    points: FloatArray,
    tetrahedra: IntArray,
    tetrahedron: int,
    point: FloatArray,
    weights: FloatArray,
) -> None:
    """Write the weights (4,) of a point (3,) in a tetrahedron that has a volume.

    Volumes are computed from edges relative to one corner, so that their rounding errors are
    relative to the tetrahedron. `points` may have further columns; three are read.
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


@kernel("i8(f8[::1])")
def _least(weights: FloatArray) -> int:
    least = 0
    for corner in range(1, 4):
        if weights[corner] < weights[least]:
            least = corner
    return least


@kernel("i8(f8[:, ::1], i8[:, ::1], f8[::1], f8[::1])")
def _scan(points: FloatArray, tetrahedra: IntArray, point: FloatArray, weights: FloatArray) -> int:
    best, best_least = 0, -np.inf
    for tetrahedron in range(tetrahedra.shape[0]):
        barycentric_3d(points, tetrahedra, tetrahedron, point, weights)
        least = weights[_least(weights)]
        if least > best_least:
            best, best_least = tetrahedron, least
    barycentric_3d(points, tetrahedra, best, point, weights)
    return best


@kernel("i8(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1])")
def locate_3d(
    points: FloatArray,
    tetrahedra: IntArray,
    start: int,
    point: FloatArray,
    weights: FloatArray,
) -> int:
    """Return the tetrahedron that holds a point and write its clipped barycentric weights.

    Parameters
    ----------
    points
        Shape (n, 3 or more); the first three columns are coordinates.
    tetrahedra
        Shape (t, 8): four corners, then the tetrahedron opposite each (-1: none).
    start
        The tetrahedron to walk from; any integer.
    point
        Shape (3,), finite. Outside of them all it gets a point of their surface.
    weights
        Shape (4,), written: not negative, with sum one.
    """
    count = tetrahedra.shape[0]
    tetrahedron = start if 0 <= start < count else 0
    found = False
    for _ in range(count + 1):
        barycentric_3d(points, tetrahedra, tetrahedron, point, weights)
        least = _least(weights)
        if weights[least] >= -_TOLERANCE:
            found = True
            break
        opposite = tetrahedra[tetrahedron, 4 + least]
        if opposite < 0:
            break
        tetrahedron = opposite
    if not found:
        tetrahedron = _scan(points, tetrahedra, point, weights)
    total = 0.0
    for corner in range(4):
        weights[corner] = max(weights[corner], 0.0)
        total += weights[corner]
    for corner in range(4):
        weights[corner] /= total
    return tetrahedron


@kernel("void(f8[:, ::1], i8[:, ::1], f8[:, ::1], i8[:, ::1], f8[:, ::1])")
def locate_many_3d(
    points: FloatArray,
    tetrahedra: IntArray,
    queries: FloatArray,
    corners: IntArray,
    weights: FloatArray,
) -> None:
    """Locate queries (k, 3) one after the other; write corners (k, 4) and weights (k, 4)."""
    tetrahedron = 0
    for index in range(queries.shape[0]):
        tetrahedron = locate_3d(points, tetrahedra, tetrahedron, queries[index], weights[index])
        for corner in range(4):
            corners[index, corner] = tetrahedra[tetrahedron, corner]
