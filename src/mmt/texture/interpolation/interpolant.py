"""What every interpolator leaves: a number and three arrays, for compiled code."""

from dataclasses import dataclass
from typing import Final

from mmt.core.arrays import FloatArray, IntArray
from mmt.texture.interpolation.radial_basis.network import RadialBasisSettings

NEAREST: Final = 0
DELAUNAY: Final = 1
RADIAL_BASIS: Final = 2


@dataclass(frozen=True, eq=False)
class Interpolant:
    """What `evaluate_into` takes; an interpolator may derive from it to remember more.

    Attributes
    ----------
    kind
        Which interpolator it is.
    rows
        Shape (n, d + w): d coordinates, then w values or weights.
    links
        Integers, such as simplices; shape (t, columns), (0, 0) where there are none.
    tail
        Further numbers, shape (l, columns), (0, 0) where there are none.
    """

    kind: int
    rows: FloatArray
    links: IntArray
    tail: FloatArray

    @property
    def networks(self) -> tuple[RadialBasisSettings, ...]:
        """Settings of the networks it consists of: level, filters; none for the others."""
        return ()
