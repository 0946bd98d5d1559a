"""What was felt of a texture: powers of short blocks, summed by stroke and place.

A *block* is a twentieth of a second in contact (`mmt.texture.field.blocks`). Its stroke (speed,
force, and heading where it counts) falls into a cell of the coordinates of
`mmt.texture.field.covariance`, and the place where it was made into a square of the surface. One
row sums the blocks of one cell at one place. Rows are all that is kept: an update is linear in the
new blocks, and a session of hours has as many rows as there are strokes and places to make them.

The place is kept because few surfaces are the same everywhere: blocks of one stroke at one place
scatter less than blocks of that stroke at several (`mmt.texture.field.scatter`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError
from mmt.texture.field.covariance import (
    CELL_WIDTHS,
    Coordinates,
    coordinates,
    points_at,
    warped,
)

LARGEST: Final = 4096
"""Rows; where there are more, the squares of the surface are made larger."""

PLACE_MM: Final = 10.0
"""Side of the squares, at first."""

_SECTORS: Final = 16
_LEAST_POWER: Final = 1e-300
_FARTHEST: Final = 2**15 - 1
_FIRST: Final = float(warped(np.zeros(1))[0])


@dataclass(frozen=True, eq=False)
class FieldCells:
    """Sums over blocks, a row for each cell of strokes and square of the surface.

    Attributes
    ----------
    directed
        Whether the heading counts.
    keys
        Cell and square of each row, shape (r, 5): steps in u and v, sector of the heading, and
        the square's steps along x and y.
    sums
        Shape (r, 4): number of blocks, sum of their powers in (m/s2)^2, of their powers'
        logarithms, and of these logarithms' squares. Powers are those at the cell's centre: the
        prior's slopes within the cell are taken out.
    place_mm
        Side of the squares.
    """

    directed: bool
    keys: IntArray
    sums: FloatArray
    place_mm: float = PLACE_MM

    @classmethod
    def of(cls, points: FloatArray, power: FloatArray, position_mm: FloatArray) -> Self:
        """Sum blocks: normalised inputs (n, 2) or (n, 3), powers (n,), positions (n, 2)."""
        stroke, power = _at_centres(points, power)
        place = np.clip(np.floor(position_mm / PLACE_MM), -_FARTHEST, _FARTHEST).astype(np.int64)
        log_power = np.log(power)
        sums = np.column_stack([np.ones(len(power)), power, log_power, np.square(log_power)])
        return cls._gathered(points.shape[1] == 3, np.hstack([stroke, place]), sums, PLACE_MM)

    @classmethod
    def of_segments(
        cls, points: FloatArray, power: FloatArray, blocks: FloatArray, scatter: float
    ) -> Self:
        """Sum segments, of which only the mean power is known.

        Parameters
        ----------
        points, power
            Normalised inputs, (n, 2) or (n, 3), and powers, (n,).
        blocks
            Blocks that each is worth, (n,), positive.
        scatter
            Variance of a block's log power that is assumed.
        """
        stroke, power = _at_centres(points, power)
        mean = np.log(power)
        squares = blocks * np.square(mean) + np.maximum(blocks - 1.0, 0.0) * scatter
        sums = np.column_stack([blocks, blocks * power, blocks * mean, squares])
        keys = np.hstack([stroke, np.zeros((len(points), 2), np.int64)])
        return cls._gathered(points.shape[1] == 3, keys, sums, PLACE_MM)

    @classmethod
    def empty(cls, *, directed: bool) -> Self:
        """Return cells without any block."""
        return cls(directed, np.zeros((0, 5), np.int64), np.zeros((0, 4)))

    @classmethod
    def _gathered(cls, directed: bool, keys: IntArray, sums: FloatArray, place_mm: float) -> Self:
        if not len(keys):
            return cls(directed, keys, sums, place_mm)
        own, rows = _unique(keys)
        total = np.zeros((len(own), sums.shape[1]))
        np.add.at(total, rows, sums)
        if len(own) <= LARGEST or (np.ptp(own[:, 3:], axis=0) <= 1).all():
            return cls(directed, own, total, place_mm)
        own[:, 3:] >>= 1
        return cls._gathered(directed, own, total, 2.0 * place_mm)

    def __len__(self) -> int:
        return len(self.keys)

    def check(self) -> None:
        """Raise `InputError` where these cannot have come from blocks."""
        counts, powers = self.sums[:, 0], self.sums[:, 1]
        steps, sectors = self.keys[:, :2], self.keys[:, 2]
        inside = (steps >= 0).all() and (steps <= 100).all()
        inside &= bool((sectors >= 0).all() and (sectors < _SECTORS).all())
        if not (np.isfinite(self.sums).all() and (counts > 0).all() and (powers > 0).all()):
            raise InputError(
                "the sums of a field's blocks must be finite, counts and powers positive"
            )
        if not (inside and np.isfinite(self.place_mm) and self.place_mm > 0.0):
            raise InputError("the cells of a field's blocks lie outside its space")

    def joined(self, other: "FieldCells") -> "FieldCells":
        """Return the cells of the blocks of both."""
        one, two = self, other
        while one.place_mm < two.place_mm:
            one = one._coarser()
        while two.place_mm < one.place_mm:
            two = two._coarser()
        keys, sums = np.vstack([one.keys, two.keys]), np.vstack([one.sums, two.sums])
        return self._gathered(self.directed, keys, sums, one.place_mm)

    def _coarser(self) -> "FieldCells":
        keys = self.keys.copy()
        keys[:, 3:] >>= 1
        return self._gathered(self.directed, keys, self.sums, 2.0 * self.place_mm)

    @cached_property
    def _strokes(self) -> tuple[IntArray, IntArray]:
        return _unique(self.keys[:, :3])

    @cached_property
    def centres(self) -> Coordinates:
        """Coordinates of the c cells of strokes that hold blocks."""
        return centres(self._strokes[0], directed=self.directed)

    @property
    def points(self) -> FloatArray:
        """Normalised inputs at these centres, (c, 2) or (c, 3)."""
        return points_at(self.centres, directed=self.directed)

    @property
    def cell_of_row(self) -> IntArray:
        """Index of the cell of strokes of each row, (r,)."""
        return self._strokes[1]

    @cached_property
    def counts(self) -> FloatArray:
        """Blocks in each cell of strokes, (c,)."""
        return np.asarray(np.bincount(self.cell_of_row, self.sums[:, 0]))

    @cached_property
    def mean_power(self) -> FloatArray:
        """Mean power of the blocks in each cell of strokes, (c,)."""
        return np.asarray(np.bincount(self.cell_of_row, self.sums[:, 1]) / self.counts)

    @cached_property
    def places_mm(self) -> tuple[FloatArray, IntArray]:
        """Centres of the squares that hold blocks (p, 2), and each row's index among them (r,)."""
        own, rows = _unique(self.keys[:, 3:])
        return np.asarray((own + 0.5) * self.place_mm, np.float64), rows


def centres(cells: IntArray, *, directed: bool) -> Coordinates:
    """Return the coordinates of the centres of cells (k, 3) of strokes."""
    width = CELL_WIDTHS[directed]
    u, v = (np.asarray(_FIRST + width * (cells[:, axis] + 0.5)) for axis in (0, 1))
    turn = 2.0 * np.pi / _SECTORS if directed else 0.0
    return Coordinates(u, v, np.asarray(turn * cells[:, 2]))


def _at_centres(points: FloatArray, power: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the cells (n, 3) of strokes, and the powers (n,) at their centres by the slopes."""
    directed = points.shape[1] == 3
    at = coordinates(points)
    stroke = _cell_of(at, directed=directed)
    apart = at.law - centres(stroke, directed=directed).law
    return stroke, np.maximum(power, _LEAST_POWER) * np.exp(-apart)


def _cell_of(at: Coordinates, *, directed: bool) -> IntArray:
    """Return the cells (k, 3) in which strokes lie."""
    width = CELL_WIDTHS[directed]
    cells = np.zeros((len(at.u), 3), np.int64)
    cells[:, 0] = np.floor((at.u - _FIRST) / width)
    cells[:, 1] = np.floor((at.v - _FIRST) / width)
    if directed:
        cells[:, 2] = np.rint(at.heading * (_SECTORS / (2.0 * np.pi))) % _SECTORS
    return cells


def _unique(keys: IntArray) -> tuple[IntArray, IntArray]:
    """Return the different rows of keys (r, k), sorted, and the index of each row among them."""
    if not len(keys):
        return keys, np.zeros(0, np.int64)
    lowest = keys.min(axis=0)
    spans = keys.max(axis=0) - lowest + 1
    flat = np.ravel_multi_index(tuple((keys - lowest).T), tuple(spans.tolist()))
    own, rows = np.unique(flat, return_inverse=True)
    different = np.column_stack(np.unravel_index(own, tuple(spans.tolist()))) + lowest
    return np.asarray(different, np.int64), rows.astype(np.int64)
