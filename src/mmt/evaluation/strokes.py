"""The strokes at which a model is compared with a known texture."""

from typing import Final, NamedTuple, Self

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.texture.model.inputs import InputSpace

GRID_SPEED_MM_S: Final[FloatArray] = np.linspace(40.0, 260.0, 12)
GRID_FORCE_N: Final[FloatArray] = np.linspace(0.4, 2.6, 12)

COARSE_SPEED_MM_S: Final[FloatArray] = np.linspace(40.0, 260.0, 6)
COARSE_FORCE_N: Final[FloatArray] = np.linspace(0.4, 2.6, 6)
"""The plane where all headings are compared as well."""

SECTORS: Final = 12
SECTOR_DEG: Final = 360.0 / SECTORS
_HEADINGS: Final = 24
"""Two a sector; odd multiples of 7.5 degrees, so that none is along or across the axes."""


class Strokes(NamedTuple):
    """Speeds, forces and headings of strokes, each of shape (k,)."""

    speed_mm_s: FloatArray
    force_n: FloatArray
    heading_rad: FloatArray

    def at(self, index: int) -> Self:
        """Return one of the strokes, shape (1,)."""
        return type(self)(*(values[index : index + 1] for values in self))

    def inputs(self, space: InputSpace) -> FloatArray:
        """Return the strokes as the inputs of a model, shape (k, d)."""
        return space.from_motion(
            self.speed_mm_s * np.cos(self.heading_rad),
            self.speed_mm_s * np.sin(self.heading_rad),
            self.force_n,
        )

    @property
    def sector(self) -> IntArray:
        """The sector of each heading, 0 to `SECTORS` - 1 from x to y, shape (k,)."""
        turns = np.mod(self.heading_rad / (2.0 * np.pi), 1.0)
        return np.minimum((turns * SECTORS).astype(np.int64), SECTORS - 1)


def over_plane() -> Strokes:
    """Return strokes of one heading over the plane, 12 x 12, forces outermost."""
    speed, force = np.meshgrid(GRID_SPEED_MM_S, GRID_FORCE_N)
    return Strokes(speed.ravel(), force.ravel(), np.zeros(speed.size))


def all_headings() -> Strokes:
    """Return strokes over the plane at all headings, 6 x 6 x 24, forces outermost."""
    headings = (np.arange(_HEADINGS) + 0.5) * (2.0 * np.pi / _HEADINGS)
    force, speed, heading = np.meshgrid(COARSE_FORCE_N, COARSE_SPEED_MM_S, headings, indexing="ij")
    return Strokes(speed.ravel(), force.ravel(), heading.ravel())
