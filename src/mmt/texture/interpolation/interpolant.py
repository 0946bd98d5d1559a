"""Interpolation of level and filter over a model's input space, in arrays for compiled code.

There are two ways: piecewise linearly over a Delaunay triangulation of samples and boundary points,
and by the network of paper B through the samples. Either gives a level that is not negative and
line spectral frequencies (LSF) that ascend strictly in (0, pi).
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.order_limit import LARGEST_ORDER
from mmt.texture.interpolation.delaunay import linear_into, triangulate
from mmt.texture.interpolation.networks.evaluation import network_arrays, network_into
from mmt.texture.interpolation.vertices import Vertices

SCRATCH: Final = 4 * LARGEST_ORDER + 1
"""Length of the scratch array that `interpolate_into` needs."""


class Interpolant(NamedTuple):
    """Arrays by which `interpolate_into` finds values.

    Attributes
    ----------
    rows
        Coordinates, then values or weights, shape (n, d + 1 + order).
    links
        Simplices as in `mmt.texture.interpolation.delaunay.Triangulation`; none of a network.
    tail
        Further numbers of a network, see `mmt.texture.interpolation.networks.evaluation`.
    """

    rows: FloatArray
    links: IntArray
    tail: FloatArray

    @property
    def is_network(self) -> bool:
        """Whether it is a network, not a triangulation."""
        return len(self.links) == 0


def triangulated(vertices: Vertices) -> Interpolant:
    """Return the piecewise linear interpolant of samples and boundary; O(n log n)."""
    mesh = triangulate(vertices.points)
    return Interpolant(vertices.table, mesh.triangles, np.zeros((0, 0)))


def networked(vertices: Vertices) -> Interpolant:
    """Return the network through the vertices that are samples; O(n^3)."""
    samples = vertices.samples
    rows, tail = network_arrays(vertices.points[:samples], vertices.values[:samples])
    return Interpolant(rows, np.zeros((0, 0), dtype=np.int64), tail)


@kernel("i8(f8[:, ::1], i8[:, ::1], f8[:, ::1], i8, f8[::1], f8[::1], f8[::1])")
def interpolate_into(
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    hint: int,
    point: FloatArray,
    values: FloatArray,
    scratch: FloatArray,
) -> int:
    """Write level and LSF (1 + order,) at a normalised point (d,), without allocation.

    `rows`, `links` and `tail` are those of an `Interpolant`. The search begins at the simplex
    `hint`, the last call's result or any integer. `scratch` holds `SCRATCH` numbers or more.
    """
    if len(links) == 0:
        network_into(rows, tail, point, values, scratch)
        return 0
    return linear_into(rows, links, hint, point, values, scratch)
