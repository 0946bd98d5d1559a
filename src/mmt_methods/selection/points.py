"""Fitted segments as points of the input space, their spectra, and the simplices around them.

Leaving a vertex out of a triangulation changes only the star of that vertex, and the corners of the
new simplices lie on the star's rim. So a triangulation of the vertex's neighbours is enough to find
the simplex around its place, and not all n points are triangulated again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Self

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, QhullError

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.core.errors import InputError
from mmt.texture.autoregression import LARGEST_ORDER
from mmt.texture.autoregression.burg import burg_batch
from mmt.texture.autoregression.forms import lsf_spectrum, reflection_to_lsf

USUAL_S: Final = 0.25
"""Length assumed for segments that are not available."""

_GRID: Final = 96  # frequencies at 1 kHz; at every rate they are 5.2 Hz apart


@dataclass(frozen=True, eq=False)
class ModelPoints:
    """Fitted segments as points of an input space.

    Attributes
    ----------
    points
        Normalised inputs, shape (n, d): speed and force, or two velocities and force, or more.
    lsf
        Line spectral frequencies in radians, shape (n, order).
    variance
        Variance of the excitation, shape (n,), positive.
    segments
        Vibration that each point was fitted to, n arrays; None if not available.
    rate_hz
        Sampling rate of the filters and the segments.
    """

    points: FloatArray
    lsf: FloatArray
    variance: FloatArray
    segments: Sequence[FloatArray] | None = None
    rate_hz: float = 1000.0

    def __post_init__(self) -> None:
        points, lsf, variance = (
            np.ascontiguousarray(values, dtype=np.float64)
            for values in (self.points, self.lsf, self.variance)
        )
        if points.ndim != 2 or not points.shape[1]:
            raise InputError(f"points have shape {points.shape}: (n, d) is needed")
        n = len(points)
        if lsf.ndim != 2 or len(lsf) != n or not 1 <= lsf.shape[1] <= LARGEST_ORDER:
            raise InputError(f"lsf has shape {lsf.shape}: ({n}, order) is needed, order 1 to 64")
        if variance.shape != (n,):
            raise InputError(f"variance has shape {variance.shape}: ({n},) is needed")
        if not np.isfinite(points).all():
            raise InputError("a point is not finite")
        if not (np.isfinite(variance).all() and (variance > 0).all()):
            raise InputError("a variance is not positive and finite")
        bounded = np.diff(lsf, axis=1, prepend=0.0, append=np.pi)
        if not (bounded > 0).all():
            raise InputError("lsf must ascend strictly inside (0, pi)")
        if self.segments is not None and len(self.segments) != n:
            raise InputError(f"{len(self.segments)} segments for {n} points")
        for name, values in (("points", points), ("lsf", lsf), ("variance", variance)):
            object.__setattr__(self, name, values)

    @classmethod
    def fitted(
        cls, points: FloatArray, segments: Sequence[FloatArray], order: int, rate_hz: float
    ) -> Self:
        """Return points (n, d) with filters of an order, fitted to their segments at a rate."""
        fits = burg_batch(segments, order)
        lsf = reflection_to_lsf(fits.reflection)
        return cls(points, lsf, fits.variances[:, -1], segments, rate_hz)

    def __len__(self) -> int:
        return len(self.points)

    def canonical(self) -> IntArray:
        """Return the order (n,) in which the points ascend by place, then by their filters.

        Ties are broken by length and sum of the segments. Points that still tie keep their order;
        they differ at most in samples of their segments.
        """
        ends = np.zeros((len(self), 2))
        if self.segments is not None:
            ends[:, 0] = [len(segment) for segment in self.segments]
            ends[:, 1] = [float(np.sum(segment)) for segment in self.segments]
        keys = np.column_stack([self.points, self.variance, self.lsf, ends])
        order: IntArray = np.lexsort(keys.T[::-1])
        return order

    def subset(self, numbers: IntArray | BoolArray) -> Self:
        """Return a subset of the points, by index or mask."""
        numbers = np.arange(len(self))[numbers]
        return replace(
            self,
            points=self.points[numbers],
            lsf=self.lsf[numbers],
            variance=self.variance[numbers],
            segments=None if self.segments is None else [self.segments[i] for i in numbers],
        )

    @property
    def frequencies(self) -> int:
        """Number of frequencies of `band` at which spectra are compared."""
        return round(_GRID * self.rate_hz / 1000.0)

    def samples(self) -> FloatArray:
        """Return the number of samples (n,) of each segment, that of `USUAL_S` if not known."""
        if self.segments is None:
            return np.full(len(self), USUAL_S * self.rate_hz)
        return np.array([max(1.0, float(len(segment))) for segment in self.segments])


def band(count: int = _GRID) -> FloatArray:
    """Return frequencies in cycles a sample, the midpoints of equal parts of (0, 1/2)."""
    return (np.arange(count, dtype=np.float64) + 0.5) * (0.5 / count)


def log_density_of(lsf: FloatArray, variance: FloatArray, count: int = _GRID) -> FloatArray:
    """Return the logarithms of the filters' exact power densities (n, f) at `band`; rate 1."""
    density = np.empty((len(lsf), count))
    for row, filter_lsf in enumerate(lsf):  # one call for all would fill the memory
        density[row] = lsf_spectrum(filter_lsf, 1.0, band(count), 1.0)
    return np.asarray(np.log(density) + np.log(variance)[:, None])


def amplitude_of(lsf: FloatArray, variance: FloatArray, count: int = _GRID) -> FloatArray:
    """Return the filters' exact amplitude spectra (n, f) at `band`; the rate is 1."""
    return np.asarray(np.exp(0.5 * log_density_of(lsf, variance, count)))


def spectral_error(estimate: FloatArray, truth: FloatArray) -> FloatArray:
    """Return paper C's equation 2: the rms of the difference of amplitudes over that of the truth.

    Parameters
    ----------
    estimate, truth
        Amplitude spectra, shape (..., f).
    """
    difference = np.sqrt(np.mean((estimate - truth) ** 2, axis=-1))
    return np.asarray(difference / np.sqrt(np.mean(truth**2, axis=-1)))


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
