"""Interpolation of level and filter over a model's input space, in arrays for compiled code.

There are two ways: piecewise linearly over a Delaunay triangulation of samples and boundary points,
and by the network of paper B through the samples. Either gives a level that is not negative and
line spectral frequencies (LSF) that ascend strictly in (0, pi).
"""

from typing import Final, NamedTuple

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression import LARGEST_ORDER
from mmt.texture.interpolation.delaunay import linear_into
from mmt.texture.interpolation.networks.evaluation import network_into

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


@kernel("i8(f8[:, ::1], i8[:, ::1], f8[:, ::1], i8, f8[::1], f8[::1], f8[::1])", inner=True)
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
