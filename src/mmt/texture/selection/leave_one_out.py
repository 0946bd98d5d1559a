"""Leave-one-out prediction for interpolators, without retraining where possible.

Selection repeatedly needs the prediction at a point by the model of all other present points. A
`LeaveOneOutModel` gives it while points are removed and added.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, QhullError

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.texture.selection.enclosing_simplex import enclose, enclose_each


class LeaveOneOutModel(Protocol):
    """A model of the present points, evaluated at a point that is left out."""

    def predict(self, index: int) -> FloatArray | None:
        """Return the values (v,) at a point's place without it; None beyond the hull.

        The point is present, or has not been yet: one that has left is forgotten.
        """
        ...

    def remove(self, index: int) -> None:
        """Remove a point permanently."""
        ...

    def add(self, index: int) -> None:
        """Add a point."""
        ...


Interpolator = Callable[[FloatArray, FloatArray, BoolArray], LeaveOneOutModel]
"""From points (n, d), values (n, v) and which are present (n,): `delaunay`, `nearest`, or
what `retrained` returns."""


def hull_of(points: FloatArray) -> IntArray:
    """Return the numbers of the corners of the convex hull, ascending: the minimal set.

    Where the points do not span the space, every one counts as a corner.
    """
    try:
        corners = ConvexHull(points).vertices
    except (QhullError, ValueError):  # flat, or fewer points than a simplex has
        return np.arange(len(points))
    return np.sort(corners).astype(np.int64)


class DelaunayNeighbours:
    """Linear interpolation in the Delaunay simplex around a point's place.

    Nothing is triangulated again. Each point has candidates, in the beginning its neighbours
    in the triangulation: the simplex around its place, when it is gone, has its corners among
    them (see `enclosing_simplex`). Where a point leaves, edges grow between its
    neighbours alone: they become candidates of each other. Where one joins, it becomes a
    candidate of all.

    Cost: O(n log n) for the triangulation of points in a plane (in space likewise for
    scattered ones), then O(neighbours) a question.

    Parameters
    ----------
    points
        Shape (n, d), d 2 or more.
    values
        Shape (n, v).
    present
        Shape (n,): which are in the model.
    """

    def __init__(self, points: FloatArray, values: FloatArray, present: BoolArray) -> None:
        self._points = np.ascontiguousarray(points, dtype=np.float64)
        self._values = np.asarray(values, dtype=np.float64)
        self._present = np.array(present, dtype=np.bool_)
        self._candidates: list[set[int]] | None = None
        if self._present.all():
            self._candidates = delaunay_stars(self._points)
        size = self._points.shape[1] + 1
        self._members = np.empty(size, dtype=np.int64)
        self._weights, self._price = np.empty(size), np.empty(size)

    def simplex(self, index: int) -> tuple[IntArray, FloatArray] | None:
        """Return corners (d + 1,) and weights (d + 1,) around a point's place without it."""
        if self._candidates is None:
            candidates = np.flatnonzero(self._present)
        else:
            candidates = np.array(sorted(self._candidates[index]), dtype=np.int64)
        was, self._present[index] = self._present[index], False
        found = enclose(
            self._points,
            candidates,
            self._present,
            self._points[index],
            self._members,
            self._weights,
            self._price,
        )
        self._present[index] = was
        return (self._members.copy(), self._weights.copy()) if found else None

    def predict(self, index: int) -> FloatArray | None:
        """See `LeaveOneOutModel`."""
        simplex = self.simplex(index)
        if simplex is None:
            return None
        members, weights = simplex
        result: FloatArray = weights @ self._values[members]
        return result

    def remove(self, index: int) -> None:
        """See `LeaveOneOutModel`."""
        self._present[index] = False
        if self._candidates is None:
            return
        rim = self._candidates[index]
        for other in rim:
            self._candidates[other] |= rim
            self._candidates[other] -= {index, other}

    def add(self, index: int) -> None:
        """See `LeaveOneOutModel`."""
        self._present[index] = True
        self._candidates = None


def delaunay_stars(points: FloatArray) -> list[set[int]]:
    """Return the neighbours of each point (n, d) in the Delaunay triangulation.

    Points at one place are neighbours of each other and share theirs. Of points that do not
    span the space all are neighbours.
    """
    try:
        triangulation = Delaunay(points)
    except (QhullError, ValueError):
        return [set(range(len(points))) - {index} for index in range(len(points))]
    starts, neighbours = triangulation.vertex_neighbor_vertices
    stars = [set(neighbours[starts[i] : starts[i + 1]].tolist()) for i in range(len(points))]
    for dropped, _, kept in triangulation.coplanar.tolist():  # at, or very near, another
        stars[dropped] = stars[kept] | {kept}
        for other in stars[dropped]:
            stars[other].add(dropped)
    return stars


def leave_each_out(points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the Delaunay simplex around every point's place without it.

    Parameters
    ----------
    points
        Shape (n, d).

    Returns
    -------
    members, weights
        Shape (n, d + 1): corners, -1 for corners of the hull, and barycentric weights.
    prices
        Shape (n, d + 1): the circumsphere, see `enclose`.

    Notes
    -----
    One triangulation and n small programmes; rebuilding costs n triangulations.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    stars = [np.array(sorted(star), dtype=np.int64) for star in delaunay_stars(points)]
    starts = np.concatenate([[0], np.cumsum([star.size for star in stars])]).astype(np.int64)
    shape = points.shape[0], points.shape[1] + 1
    members = np.empty(shape, dtype=np.int64)
    weights, prices = np.zeros(shape), np.zeros(shape)
    if len(points):
        enclose_each(
            points,
            np.concatenate(stars),
            starts,
            np.ones(len(points), dtype=np.bool_),
            np.arange(len(points)),
            members,
            weights,
            prices,
        )
    return members, weights, prices


class NearestNeighbour:
    """The values of the nearest other point; O(n) a question. Never beyond a hull."""

    def __init__(self, points: FloatArray, values: FloatArray, present: BoolArray) -> None:
        self._points = np.asarray(points, dtype=np.float64)
        self._values = np.asarray(values, dtype=np.float64)
        self._present = np.array(present, dtype=np.bool_)

    def predict(self, index: int) -> FloatArray | None:
        """See `LeaveOneOutModel`."""
        squares = ((self._points - self._points[index]) ** 2).sum(axis=1)
        squares[~self._present] = np.inf
        squares[index] = np.inf
        nearest = int(np.argmin(squares))
        return self._values[nearest] if np.isfinite(squares[nearest]) else None

    def remove(self, index: int) -> None:
        """See `LeaveOneOutModel`."""
        self._present[index] = False

    def add(self, index: int) -> None:
        """See `LeaveOneOutModel`."""
        self._present[index] = True


class Retrained:
    """Any interpolator at all, trained anew for every question.

    Parameters
    ----------
    points, values, present
        As in `DelaunayNeighbours`.
    train
        From points (k, d) and values (k, v) makes a function from places (q, d) to values
        (q, v), which may raise `ValueError` or `QhullError` where the points do not suffice.
    """

    def __init__(
        self,
        points: FloatArray,
        values: FloatArray,
        present: BoolArray,
        train: "Train",
    ) -> None:
        self._points = np.asarray(points, dtype=np.float64)
        self._values = np.asarray(values, dtype=np.float64)
        self._present = np.array(present, dtype=np.bool_)
        self._train = train

    def predict(self, index: int) -> FloatArray | None:
        """See `LeaveOneOutModel`."""
        others = self._present.copy()
        others[index] = False
        try:
            model = self._train(self._points[others], self._values[others])
        except (ValueError, QhullError):
            return None
        values = np.asarray(model(self._points[index : index + 1]))[0]
        return values if np.isfinite(values).all() else None

    def remove(self, index: int) -> None:
        """See `LeaveOneOutModel`."""
        self._present[index] = False

    def add(self, index: int) -> None:
        """See `LeaveOneOutModel`."""
        self._present[index] = True


Train = Callable[[FloatArray, FloatArray], Callable[[FloatArray], FloatArray]]


def retrained(train: Train) -> Interpolator:
    """Return an interpolator that trains anew for every question; see `Retrained`."""
    return lambda points, values, present: Retrained(points, values, present, train)
