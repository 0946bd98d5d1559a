"""How a model's samples become values everywhere: one protocol, a table of interpolators.

An interpolator is built from points and values, and leaves an `Interpolant`: a number and
three arrays. From these, `evaluate_into` computes the values at a point in compiled code,
without the interpreter lock and without allocation, and so serves the rendering and whole
arrays alike. A new interpolator is a module with a builder and a kernel, a line in `BUILDERS`
and a branch in `evaluate_into`.

Values are a level, not negative, and line spectral frequencies, strictly ascending in
(0, pi); what an interpolator returns is to be the same. Delaunay and nearest return convex
combinations, which are; the networks of ``"rbf"`` are made valid in
`mmt.texture.interpolation.radial_basis.evaluation`.
"""

import importlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Protocol

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.split import separate
from mmt.texture.interpolation.delaunay import locate, triangulate
from mmt.texture.interpolation.interpolant import DELAUNAY, NEAREST, Interpolant
from mmt.texture.interpolation.radial_basis.evaluation import SCRATCH, radial_basis_into
from mmt.texture.interpolation.radial_basis.network import RadialBasisSettings
from mmt.texture.interpolation.tetrahedra import locate_3d

LARGEST_SCRATCH: Final = SCRATCH
"""Numbers of scratch that `evaluate_into` may need."""

_NO_LINKS: Final[IntArray] = np.zeros((0, 0), dtype=np.int64)
_NO_TAIL: Final[FloatArray] = np.zeros((0, 0))


class Builder(Protocol):
    """Build an interpolant."""

    def __call__(
        self,
        points: FloatArray,
        values: FloatArray,
        samples: int,
        previous: Interpolant | None,
        networks: tuple[RadialBasisSettings, ...],
    ) -> Interpolant:
        """Build it from distinct points that span the space.

        Parameters
        ----------
        points
            Normalised, shape (n, d), d 2 or 3.
        values
            Level and line spectral frequencies, shape (n, 1 + order).
        samples
            So many of the points, the first ones, are samples; the others are the boundary.
        previous
            What the same builder returned for an earlier state of the model, None at first:
            most of its points are still there, and boundary points have kept their place,
            but not their values.
        networks
            What `Interpolant.networks` was of the same points and values, by which it is
            built as it was; empty where it is to be chosen.
        """
        ...


def _build_delaunay(
    points: FloatArray,
    values: FloatArray,
    samples: int,
    previous: Interpolant | None,
    networks: tuple[RadialBasisSettings, ...],
) -> Interpolant:
    """Triangulate anew, which costs O(n log n)."""
    del samples, previous, networks
    return Interpolant(DELAUNAY, _joined(points, values), triangulate(points).triangles, _NO_TAIL)


def _build_nearest(
    points: FloatArray,
    values: FloatArray,
    samples: int,
    previous: Interpolant | None,
    networks: tuple[RadialBasisSettings, ...],
) -> Interpolant:
    del samples, previous, networks
    return Interpolant(NEAREST, _joined(points, values), _NO_LINKS, _NO_TAIL)


def _build_radial_basis(
    points: FloatArray,
    values: FloatArray,
    samples: int,
    previous: Interpolant | None,
    networks: tuple[RadialBasisSettings, ...],
) -> Interpolant:
    """Solve for samples and silence, or let an earlier solution grow, O(n^2) a sample."""
    from mmt.texture.interpolation.radial_basis.model import build_radial_basis

    is_silent = values[:, 0] == 0.0
    is_silent[:samples] = False
    silent = points[is_silent]
    return build_radial_basis(points[:samples], values[:samples], silent, previous, networks)


def _joined(points: FloatArray, values: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.hstack([points, values]))


BUILDERS: Final[Mapping[str, Builder]] = MappingProxyType(
    {"delaunay": _build_delaunay, "nearest": _build_nearest, "rbf": _build_radial_basis}
)
"""Every interpolator by its name in the scene."""


def load(interpolator: str) -> None:
    """Load what an interpolator has compiled, so that no update of a model waits for it."""
    if interpolator == "rbf":
        importlib.import_module("mmt.texture.interpolation.radial_basis.model")


@kernel("i8(f8[:, ::1], f8[::1], f8[::1])")
def _nearest_into(rows: FloatArray, point: FloatArray, values: FloatArray) -> int:
    """Copy the values of the row nearest to a point; return its number. O(n)."""
    dimensions = len(point)
    nearest, least = 0, np.inf
    for row in range(rows.shape[0]):
        square = 0.0
        for k in range(dimensions):
            square += (rows[row, k] - point[k]) ** 2
        if square < least:
            nearest, least = row, square
    for k in range(len(values)):
        values[k] = rows[nearest, dimensions + k]
    return nearest


@kernel("i8(f8[:, ::1], i8[:, ::1], i8, f8, f8, f8[::1], f8[::1])")
def planar_into(
    rows: FloatArray,
    links: IntArray,
    hint: int,
    x: float,
    y: float,
    values: FloatArray,
    weights: FloatArray,
) -> int:
    """Do `evaluate_into` for Delaunay in the plane, with less to pass on."""
    found = locate(rows, links, hint, x, y, weights)
    a, b, c = links[found, 0], links[found, 1], links[found, 2]
    of_a, of_b, of_c = weights[0], weights[1], weights[2]
    before, apart = 0.0, True
    values[0] = of_a * rows[a, 2] + of_b * rows[b, 2] + of_c * rows[c, 2]
    for k in range(1, len(values)):
        value = of_a * rows[a, 2 + k] + of_b * rows[b, 2 + k] + of_c * rows[c, 2 + k]
        apart = apart and before < value < np.pi
        values[k] = before = value
    if not apart:  # rounding has let frequencies meet
        separate(values[1:])
    return found


@kernel("i8(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1], f8[::1])")
def _spatial_into(
    rows: FloatArray,
    links: IntArray,
    hint: int,
    point: FloatArray,
    values: FloatArray,
    weights: FloatArray,
) -> int:
    """Do `evaluate_into` for Delaunay in space."""
    found = locate_3d(rows, links, hint, point, weights)
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
    if not apart:
        separate(values[1:])
    return found


@kernel("i8(i8, f8[:, ::1], i8[:, ::1], f8[:, ::1], i8, f8[::1], f8[::1], f8[::1])")
def evaluate_into(
    kind: int,
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    hint: int,
    point: FloatArray,
    values: FloatArray,
    scratch: FloatArray,
) -> int:
    """Write level and line spectral frequencies at a point; return where it was found.

    Parameters
    ----------
    kind, rows, links, tail
        See `Interpolant`.
    hint
        What the last call returned, from which a search begins; any integer.
    point
        Normalised, shape (d,), finite.
    values
        Shape (1 + order,), written.
    scratch
        Shape (`LARGEST_SCRATCH`,) or longer.
    """
    if kind == DELAUNAY and len(point) == 2:
        return planar_into(rows, links, hint, point[0], point[1], values, scratch)
    if kind == DELAUNAY:
        return _spatial_into(rows, links, hint, point, values, scratch)
    if kind == NEAREST:
        return _nearest_into(rows, point, values)
    radial_basis_into(rows, links, tail, point, values, scratch)
    return 0
