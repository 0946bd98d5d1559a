"""Delaunay simplices around any place, and around each point's place with that point left out.

Leaving a vertex out of a triangulation changes only the star of that vertex, and the corners of the
new simplices lie on the star's rim. So a triangulation of the vertex's neighbours is enough to find
the simplex around its place, and not all n points are triangulated again.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, QhullError

from mmt.core.arrays import FloatArray, IntArray


class EnclosingSimplices(NamedTuple):
    """Simplices around q places: ``members`` (q, d + 1), -1 if beyond the hull, and ``weights``.

    The weights (q, d + 1) are the barycentric coordinates.
    """

    members: IntArray
    weights: FloatArray

    @property
    def found(self) -> IntArray:
        """Indices of the places that have a simplex."""
        return np.flatnonzero(self.members[:, 0] >= 0)

    def interpolate(self, values: FloatArray) -> FloatArray:
        """Return values (n, v) interpolated at the places, (q, v); NaN beyond the hull."""
        result = np.full((len(self.members), values.shape[1]), np.nan)
        inside = self.found
        corners = values[self.members[inside]]
        result[inside] = np.einsum("qc,qcv->qv", self.weights[inside], corners)
        return result


def hull_of(points: FloatArray) -> IntArray:
    """Return the indices of the corners of the convex hull, ascending: the minimal set.

    If the points do not span the space, every point counts as a corner.
    """
    try:
        corners = ConvexHull(points).vertices
    except (QhullError, ValueError):  # flat, or fewer points than a simplex has
        return np.arange(len(points))
    return np.asarray(np.sort(corners), np.int64)


def enclose(points: FloatArray, places: FloatArray) -> EnclosingSimplices:
    """Return the simplices of the triangulation of n points around q places.

    Parameters
    ----------
    points, places
        Shapes (n, d) and (q, d). Points that do not span the space have no simplex.
    """
    count, dimensions = places.shape
    members = np.full((count, dimensions + 1), -1, dtype=np.int64)
    weights = np.zeros((count, dimensions + 1))
    try:
        triangulation = Delaunay(points)
    except (QhullError, ValueError):
        return EnclosingSimplices(members, weights)
    simplex = triangulation.find_simplex(places)
    inside = np.flatnonzero(simplex >= 0)
    transform = triangulation.transform[simplex[inside]]
    shares = np.einsum(
        "qij,qj->qi", transform[:, :dimensions], places[inside] - transform[:, dimensions]
    )
    shares = np.maximum(np.column_stack([shares, 1.0 - shares.sum(axis=1)]), 0.0)
    known = np.isfinite(shares).all(axis=1)  # a simplex without volume has no coordinates
    members[inside[known]] = triangulation.simplices[simplex[inside]][known]
    weights[inside[known]] = shares[known] / shares[known].sum(axis=1, keepdims=True)
    return EnclosingSimplices(members, weights)


def enclose_without(points: FloatArray) -> EnclosingSimplices:
    """Return the simplex around each of n points (n, d), with that point left out.

    One triangulation of all points and one of each point's neighbours: O(n log n) for scattered
    points.
    """
    members = np.full((len(points), points.shape[1] + 1), -1, dtype=np.int64)
    weights = np.zeros(members.shape)
    for index, star in enumerate(_stars(points)):
        rim = np.array(sorted(star), dtype=np.int64)
        around = enclose(points[rim], points[index : index + 1])
        if around.found.size:
            members[index], weights[index] = rim[around.members[0]], around.weights[0]
    return EnclosingSimplices(members, weights)


def _stars(points: FloatArray) -> list[set[int]]:
    """Return the neighbours of each point in the triangulation; none if points are flat.

    Points at one place are neighbours of each other, and share all other neighbours.
    """
    try:
        triangulation = Delaunay(points)
    except (QhullError, ValueError):
        return [set() for _ in points]
    starts, neighbours = triangulation.vertex_neighbor_vertices
    stars = [set(neighbours[starts[i] : starts[i + 1]].tolist()) for i in range(len(points))]
    for dropped, _, kept in triangulation.coplanar.tolist():  # at, or very near, another point
        stars[dropped] = stars[kept] | {kept}
        for other in stars[dropped]:
            stars[other].add(dropped)
    return stars
