"""The Delaunay simplex around a point, without a triangulation.

The Delaunay triangulation of points is the lower hull of the points lifted to the paraboloid
``|x|^2``. Below a query q lies the facet that answers the linear programme

    minimise  sum_j w_j |x_j - q|^2   with  sum_j w_j x_j = q,  sum_j w_j = 1,  w_j >= 0,

whose basic solution is the Delaunay simplex around q and its barycentric weights (Fukuda,
"Frequently asked questions in polyhedral computation", 2004, section 3.5). A simplex method
solves it: what enters the basis is the point deepest in the circumsphere of the simplex that
is held, so that it ends when that sphere is empty, which is Delaunay's own criterion.

The same answer comes from any set of candidates that holds the simplex. Leaving a vertex out
of a triangulation changes the star of that vertex alone, and the new simplices have their
corners on the star's rim: the neighbours of a vertex are candidates enough for the simplex
around its place when it is gone. So no triangulation is made for it.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.core.compiled import kernel

_FAR: Final = 1e8  # cost of a stand-in, in squares of the reach
_EMPTY: Final = 1e-12  # how far inside a circumsphere a point may lie, relative to its square
_LEAST: Final = 1e-13  # a smaller entry is no pivot
_LIGHT: Final = 1e-9  # weight of a stand-in that is rounding


@kernel("f8(f8[:, ::1], i8[::1], f8[::1])")
def _reach(points: FloatArray, candidates: IntArray, query: FloatArray) -> float:
    """Return the largest distance from the query along an axis."""
    reach = 0.0
    for k in range(candidates.size):
        for axis in range(query.size):
            reach = max(reach, abs(points[candidates[k], axis] - query[axis]))
    return reach


@kernel("void(f8[:, ::1], f8[::1], i8[::1], f8)")
def _begin(inverse: FloatArray, weights: FloatArray, members: IntArray, reach: float) -> None:
    """Hold a simplex of stand-ins around the query; write the inverse of its equations.

    Corners are ``s e_k`` and ``-s (1, ..., 1)`` with s twice the reach times the dimension,
    which encloses every candidate; a stand-in has the number -1 - k.
    """
    d = members.size - 1
    side = 2.0 * d * reach if reach > 0.0 else 1.0
    share = 1.0 / (d + 1)
    for row in range(d + 1):
        members[row] = -1 - row
        weights[row] = share
        for column in range(d):
            inverse[row, column] = -share / side
        if row < d:
            inverse[row, row] += 1.0 / side
        inverse[row, d] = share


@kernel("UniTuple(f8, 2)(f8[:, ::1], i8, f8[::1], f8[::1])")
def _priced(
    points: FloatArray, candidate: int, query: FloatArray, price: FloatArray
) -> tuple[float, float]:
    """Return how far a candidate lies outside the circumsphere (squared), and its cost."""
    cost = 0.0
    value = price[query.size]
    for axis in range(query.size):
        offset = points[candidate, axis] - query[axis]
        cost += offset * offset
        value += price[axis] * offset
    return cost - value, cost


@kernel("i8(f8[:, ::1], i8[::1], b1[::1], f8[::1], f8[::1], f8)")
def _deepest(
    points: FloatArray,
    candidates: IntArray,
    present: BoolArray,
    query: FloatArray,
    price: FloatArray,
    scale: float,
) -> int:
    """Return the candidate deepest inside the circumsphere, -1 where it is empty."""
    best, least = -1, 0.0
    for k in range(candidates.size):
        if not present[candidates[k]]:
            continue
        outside, cost = _priced(points, candidates[k], query, price)
        if outside < least and outside < -_EMPTY * (scale + cost):
            best, least = candidates[k], outside
    return best


@kernel("b1(f8[:, ::1], f8[::1], i8[::1], f8[::1], i8)")
def _exchange(
    inverse: FloatArray, weights: FloatArray, members: IntArray, column: FloatArray, entering: int
) -> bool:
    """Let a point with the given column enter the basis; false where nothing can leave."""
    leaving, least = -1, np.inf
    for row in range(members.size):
        if column[row] > _LEAST:
            ratio = max(weights[row], 0.0) / column[row]
            if ratio < least:
                leaving, least = row, ratio
    if leaving < 0:
        return False
    pivot = column[leaving]
    inverse[leaving] /= pivot
    weights[leaving] = least
    for row in range(members.size):
        if row != leaving:
            inverse[row] -= column[row] * inverse[leaving]
            weights[row] -= column[row] * least
    members[leaving] = entering
    return True


@kernel("void(f8[:, ::1], f8[::1], i8[::1], f8[:, ::1], f8, f8[::1])")
def _set_price(
    points: FloatArray,
    query: FloatArray,
    members: IntArray,
    inverse: FloatArray,
    far: float,
    price: FloatArray,
) -> None:
    """Write the affine function that has each corner's cost at that corner."""
    price[:] = 0.0
    for row in range(members.size):
        cost = far
        if members[row] >= 0:
            cost = 0.0
            for axis in range(query.size):
                cost += (points[members[row], axis] - query[axis]) ** 2
        for k in range(members.size):
            price[k] += cost * inverse[row, k]


@kernel("b1(i8[::1], f8[::1])")
def _settle(members: IntArray, weights: FloatArray) -> bool:
    """Clean the answer; false where a stand-in carries weight."""
    total = 0.0
    for row in range(members.size):
        weights[row] = max(weights[row], 0.0)
        if members[row] < 0 and weights[row] > _LIGHT:
            return False
        total += weights[row]
    heaviest = members[np.argmax(weights)]
    for row in range(members.size):
        if members[row] < 0:  # the query lies on a face
            members[row] = heaviest
            weights[row] = 0.0
        weights[row] /= total
    return True


@kernel("b1(f8[:, ::1], i8[::1], b1[::1], f8[::1], i8[::1], f8[::1], f8[::1])")
def enclose(
    points: FloatArray,
    candidates: IntArray,
    present: BoolArray,
    query: FloatArray,
    members: IntArray,
    weights: FloatArray,
    price: FloatArray,
) -> bool:
    """Write the Delaunay simplex around a query, and say whether there is one.

    Parameters
    ----------
    points
        Shape (n, d), finite.
    candidates
        Numbers of points among which the simplex is; none twice.
    present
        Shape (n,): points that are not present are passed over.
    query
        Shape (d,).
    members, weights
        Shape (d + 1,), written: the corners and their barycentric weights, which are zero
        for corners that the query does not need where it lies on a face.
    price
        Shape (d + 1,), written: a point x lies inside the simplex's circumsphere where
        ``|x - query|^2 < price[:d] . (x - query) + price[d]``.

    Notes
    -----
    Each exchange costs O(candidates d); a handful to some tens are made. False where the
    query lies outside the convex hull of the candidates that are present.
    """
    d = query.size
    inverse = np.empty((d + 1, d + 1))
    column = np.empty(d + 1)
    reach = _reach(points, candidates, query)
    scale = reach * reach
    _begin(inverse, weights, members, reach)
    for _ in range(64 + 8 * d + candidates.size):
        _set_price(points, query, members, inverse, _FAR * scale, price)
        entering = _deepest(points, candidates, present, query, price, scale * 1e-3)
        if entering < 0:
            break
        for row in range(d + 1):
            column[row] = inverse[row, d]
            for axis in range(d):
                column[row] += inverse[row, axis] * (points[entering, axis] - query[axis])
        if not _exchange(inverse, weights, members, column, entering):
            break
    return _settle(members, weights)


@kernel("void(f8[:, ::1], i8[::1], i8[::1], b1[::1], i8[::1], i8[:, ::1], f8[:, ::1], f8[:, ::1])")
def enclose_each(
    points: FloatArray,
    candidates: IntArray,
    starts: IntArray,
    present: BoolArray,
    queries: IntArray,
    members: IntArray,
    weights: FloatArray,
    prices: FloatArray,
) -> None:
    """Do `enclose` at the place of each of the points `queries`, which count as absent.

    Parameters
    ----------
    candidates, starts
        The candidates of the query number k are ``candidates[starts[k]:starts[k + 1]]``.
    members, weights, prices
        Shape (q, d + 1), written; members are -1 where there is no simplex.
    """
    for k in range(queries.size):
        index = queries[k]
        was = present[index]
        present[index] = False
        found = enclose(
            points,
            candidates[starts[k] : starts[k + 1]],
            present,
            points[index],
            members[k],
            weights[k],
            prices[k],
        )
        present[index] = was
        if not found:
            members[k] = -1
