"""Log powers of short blocks of vibration, summed by stroke and moment.

A *block* is a twentieth of a second in contact (`mmt.texture.field.blocks`). Its stroke (speed,
force, and heading if it counts) falls into a cell of the coordinates of
`mmt.texture.field.covariance`, and its time into a *moment* of half a second. One row sums the
blocks of one cell in one moment. Only rows are kept: the cost of an update is linear in the new
blocks, and a session of hours has no more than `LARGEST` rows.

Moments are kept because a disturbance (a knock, a slip, a patch of the surface) affects all blocks
of a moment together. So a row counts for less than its blocks would singly, and a row that
disagrees with all others can be recognised (`mmt.texture.field.observations`).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError

if TYPE_CHECKING:
    from mmt.texture.field.covariance import Coordinates

# The covariance's compiled code is imported where it is used: a process that hands on, saves and
# renders models needs none of it.

LARGEST: Final = 4096
"""Largest number of rows; beyond it, moments are joined in pairs."""

MOMENT_BLOCKS: Final = 10
"""Initial number of blocks in a moment, half a second."""

FELT_POWER: Final = 1e-3
"""Power in (m/s2)^2 that is added to that of every block: 0.03 m/s2 rms, which nobody feels (at the
fingertip thresholds are 0.1 m/s2 and more, ISO 13091-1). Less power is equally silent."""

_SECTORS: Final = 16
_LAST: Final = ((20, 20, 0), (6, 6, _SECTORS - 1))
"""Last cell of the space, without and with heading: what `_at_centres` gives at its corner."""


@dataclass(frozen=True, eq=False)
class FieldCells:
    """Rows of blocks, one for each cell of strokes and moment.

    Attributes
    ----------
    directed
        Whether the heading counts.
    keys
        Cell and moment of each row, shape (r, 4): steps in u and v, sector of the heading, and the
        moment's number.
    sums
        Shape (r, 4): number of blocks, and sums of their powers, each plus `FELT_POWER`, in
        (m/s2)^2, of the logarithms of these powers, and of the squared logarithms. The prior's
        slopes convert powers to the cell's centre.
    moment_blocks
        Number of blocks in a moment.
    """

    directed: bool
    keys: IntArray
    sums: FloatArray
    moment_blocks: int = MOMENT_BLOCKS

    @classmethod
    def from_blocks(cls, points: FloatArray, power: FloatArray, block: IntArray) -> Self:
        """Gather blocks: normalised inputs (n, 2) or (n, 3), powers (n,), numbers in time (n,)."""
        stroke, level = _at_centres(points, power)
        keys = np.column_stack([stroke, block // MOMENT_BLOCKS])
        sums = np.column_stack([np.ones(len(level)), np.exp(level), level, np.square(level)])
        return cls._gathered(points.shape[1] == 3, keys, sums, MOMENT_BLOCKS)

    @classmethod
    def of_segments(
        cls, points: FloatArray, power: FloatArray, blocks: FloatArray, scatter: float
    ) -> Self:
        """Gather segments, of which only the mean power is known.

        Parameters
        ----------
        points, power
            Normalised inputs, (n, 2) or (n, 3), and powers, (n,).
        blocks
            Number of blocks that each segment is worth, (n,), positive.
        scatter
            Assumed variance of a block's log power.
        """
        stroke, level = _at_centres(points, power)
        keys = np.column_stack([stroke, np.arange(len(points))])
        mean = level - 0.5 * scatter
        squares = blocks * np.square(mean) + np.maximum(blocks - 1.0, 0.0) * scatter
        sums = np.column_stack([blocks, blocks * np.exp(level), blocks * mean, squares])
        return cls._gathered(points.shape[1] == 3, keys, sums, MOMENT_BLOCKS)

    @classmethod
    def _gathered(
        cls, directed: bool, keys: IntArray, sums: FloatArray, moment_blocks: int
    ) -> Self:
        if not len(keys):
            return cls(directed, keys, sums, moment_blocks)
        own, rows = distinct_rows(keys)
        total = np.zeros((len(own), sums.shape[1]))
        np.add.at(total, rows, sums)
        if len(own) <= LARGEST or np.ptp(own[:, 3]) <= 1:
            return cls(directed, own, total, moment_blocks)
        own[:, 3] >>= 1
        return cls._gathered(directed, own, total, 2 * moment_blocks)

    def __len__(self) -> int:
        return len(self.keys)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the rows alone, without what was computed from them."""
        return type(self), (self.directed, self.keys, self.sums, self.moment_blocks)

    def check(self) -> None:
        """Raise `InputError` if the rows cannot have come from blocks."""
        counts, powers = self.sums[:, 0], self.sums[:, 1]
        strokes = self.keys[:, :3]
        inside = bool(((strokes >= 0) & (strokes <= _LAST[self.directed])).all())
        if not (np.isfinite(self.sums).all() and (counts > 0).all() and (powers > 0).all()):
            raise InputError(
                "the sums of a field's blocks must be finite, counts and powers positive"
            )
        if not (inside and self.moment_blocks > 0):
            raise InputError("the cells of a field's blocks lie outside its space")

    def joined(self, other: "FieldCells") -> "FieldCells":
        """Return the cells of the blocks of both."""
        blocks = max(self.moment_blocks, other.moment_blocks)
        keys = [one.keys // [1, 1, 1, blocks // one.moment_blocks] for one in (self, other)]
        sums = np.vstack([self.sums, other.sums])
        return self._gathered(self.directed, np.vstack(keys), sums, blocks)

    def scaled(self, gain: FloatArray) -> Self:
        """Return the rows with their powers multiplied by positive gains, (r,)."""
        count, power, first, second = self.sums.T
        more = np.log(gain)
        squares = second + more * (2.0 * first + more * count)
        sums = np.column_stack([count, power * gain, first + more * count, squares])
        return replace(self, sums=sums)

    @cached_property
    def _strokes(self) -> tuple[IntArray, IntArray]:
        return distinct_rows(self.keys[:, :3])

    @cached_property
    def centres(self) -> "Coordinates":
        """Coordinates of the c cells of strokes that hold blocks."""
        return centres(self._strokes[0], directed=self.directed)

    @property
    def points(self) -> FloatArray:
        """Normalised inputs at these centres, (c, 2) or (c, 3)."""
        from mmt.texture.field.covariance import points_at

        return points_at(self.centres, directed=self.directed)

    @property
    def cell_of_row(self) -> IntArray:
        """Index of the cell of strokes of each row, (r,)."""
        return self._strokes[1]


def centres(cells: IntArray, *, directed: bool) -> "Coordinates":
    """Return the coordinates of the centres of cells (k, 3) of strokes."""
    from mmt.texture.field.covariance import CELL_WIDTHS, FIRST, Coordinates

    width = CELL_WIDTHS[directed]
    u, v = (np.asarray(FIRST + width * (cells[:, axis] + 0.5)) for axis in (0, 1))
    turn = 2.0 * np.pi / _SECTORS if directed else 0.0
    return Coordinates(u, v, np.asarray(turn * cells[:, 2]))


def _at_centres(points: FloatArray, power: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the cells (n, 3) of strokes, and the log powers (n,) at the cells' centres."""
    from mmt.texture.field.covariance import CELL_WIDTHS, FIRST, coordinates

    directed, at = points.shape[1] == 3, coordinates(points)
    cells = np.zeros((len(points), 3), np.int64)
    cells[:, :2] = np.floor((np.column_stack([at.u, at.v]) - FIRST) / CELL_WIDTHS[directed])
    if directed:
        cells[:, 2] = np.rint(at.heading * (_SECTORS / (2.0 * np.pi))) % _SECTORS
    apart = at.law - centres(cells, directed=directed).law
    return cells, np.log(power + FELT_POWER) - apart


def distinct_rows(keys: IntArray) -> tuple[IntArray, IntArray]:
    """Return the distinct rows of keys (r, k), sorted, and the index of each row among them."""
    from mmt.texture.field.covariance import different

    if not len(keys):
        return keys, np.zeros(0, np.int64)
    lowest = keys.min(axis=0)
    spans = keys.max(axis=0) - lowest + 1
    flat = np.ravel_multi_index(tuple((keys - lowest).T), tuple(spans.tolist()))
    rows = np.empty_like(flat)
    own = different(flat, rows)
    back = np.column_stack(np.unravel_index(own, tuple(spans.tolist()))) + lowest
    return np.asarray(back, np.int64), rows
