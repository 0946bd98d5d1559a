"""What was felt of a surface: means of blocks by cell of strokes, and how its blocks scatter.

The scatter is learned from the surface itself, as `mmt.texture.field.scatter` learns that of the
level: half the mean square of the difference of two blocks that follow each other is the *nugget*,
the scatter of single blocks; that of blocks of one stroke at different times and places holds the
*sill* besides, what places of the surface have in common.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.field.covariance import Coordinates
from mmt.texture.surfaces.bands import COMPONENTS
from mmt.texture.surfaces.blocks import SurfaceBlock, coordinates_of
from mmt.texture.surfaces.prior import NUGGET, SILL

LARGEST: Final = 120
"""Largest number of cells; beyond, the least recently touched one is dropped."""

PRIOR_BLOCKS: Final = 6.0
"""Blocks that the scatter of white noise counts as, before this surface's own."""

_PLANAR_WIDTH, _DIRECTED_WIDTH = 0.25, 0.5
_SECTORS: Final = 16
_SAME: Final = 0.1
"""Strokes whose u and v differ by less are one, for the nugget."""

_VISIT_SAMPLES: Final = 300
"""A cell left for longer is visited anew: what a stroke has in common is another one then."""

_LARGEST_COUNT: Final = 400.0
"""Blocks in a cell beyond which old ones fade: surfaces wear."""


@dataclass
class _Cell:
    stroke: FloatArray
    values: FloatArray
    count: float = 0.0
    visits: int = 0
    last: int = -1

    def add(self, block: SurfaceBlock) -> None:
        self.count = min(self.count + 1.0, _LARGEST_COUNT)
        share = 1.0 / self.count
        apart = block.stroke - self.stroke
        apart[2] = (apart[2] + np.pi) % (2.0 * np.pi) - np.pi  # headings go round
        self.stroke = self.stroke + share * apart
        self.values = self.values + share * (block.values - self.values)
        self.visits += block.start - self.last > _VISIT_SAMPLES or self.last < 0
        self.last = block.start


class SurfaceCells:
    """Blocks of one surface, merged in cells of strokes; the cost does not grow with time.

    Parameters
    ----------
    directed
        Whether the heading counts.
    """

    def __init__(self, *, directed: bool) -> None:
        self.directed = directed
        self.blocks = 0
        """Number of blocks added."""
        self._cells: dict[tuple[int, ...], _Cell] = {}
        self._near = PRIOR_BLOCKS * NUGGET
        self._near_weight = self._far_weight = PRIOR_BLOCKS
        self._far = self._near.copy()
        self._last: SurfaceBlock | None = None

    def __len__(self) -> int:
        return len(self._cells)

    @property
    def nugget(self) -> FloatArray:
        """Variance of single blocks about what their place has in common, (`COMPONENTS`,)."""
        return np.asarray(self._near / self._near_weight)

    @property
    def sill(self) -> FloatArray:
        """Variance between places, (`COMPONENTS`,)."""
        return np.asarray(np.maximum(self._far / self._far_weight - self.nugget, 0.0) + SILL)

    @property
    def centres(self) -> Coordinates:
        """Coordinates of the cells, (c,) each."""
        return coordinates_of(np.array([cell.stroke for cell in self._cells.values()]))

    @property
    def values(self) -> FloatArray:
        """Mean components of the cells, (c, `COMPONENTS`)."""
        return np.array([cell.values for cell in self._cells.values()])

    @property
    def errors(self) -> FloatArray:
        """Variances of these means, (`COMPONENTS`, c)."""
        cells = self._cells.values()
        counts = np.array([cell.count for cell in cells])
        visits = np.array([cell.visits for cell in cells])
        return np.asarray(self.nugget[:, None] / counts + self.sill[:, None] / visits)

    def add(self, blocks: Sequence[SurfaceBlock]) -> None:
        """Add blocks of this surface, in their order."""
        together: dict[tuple[int, ...], list[SurfaceBlock]] = defaultdict(list)
        for block in blocks:
            self._compare(block)
            together[self._key(block)].append(block)
        for key, some in together.items():
            cell = self._cells.pop(key, None)
            if cell is None:
                cell = _Cell(np.zeros(3), np.zeros(COMPONENTS))
            else:
                apart = np.mean([np.square(block.values - cell.values) for block in some], axis=0)
                self._far += cell.count / (cell.count + 1.0) * apart
                self._far_weight += 1.0
            for block in some:
                cell.add(block)
            self._cells[key] = cell  # behind those that were touched before
        while len(self._cells) > LARGEST:
            del self._cells[next(iter(self._cells))]
        self.blocks += len(blocks)

    def _compare(self, block: SurfaceBlock) -> None:
        """Learn the nugget from a block and the one before it, if both are of one stroke."""
        last, self._last = self._last, block
        if last is None or last.stop != block.start:
            return
        if np.abs(block.stroke - last.stroke)[:2].max() < _SAME:
            self._near += 0.5 * np.square(block.values - last.values)
            self._near_weight += 1.0

    def _key(self, block: SurfaceBlock) -> tuple[int, ...]:
        width = _DIRECTED_WIDTH if self.directed else _PLANAR_WIDTH
        key = np.floor(block.stroke[:2] / width).astype(int).tolist()
        if self.directed:
            key.append(round(float(block.stroke[2]) * _SECTORS / (2.0 * np.pi)) % _SECTORS)
        return tuple(key)
