"""What is kept from one search for outliers to the next, among mostly the same points."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray

_GROWTH: Final = 1.25  # of the number of outliers, from which their blow is searched for anew


class SearchCache:
    """What earlier searches found: outliers, bursts by a segment and its neighbours, a blow.

    A search begins with the last one's outliers left out; they are asked in its end. `name`
    gives the points of the next search their numbers; what two searches in a row have not
    asked for is forgotten.
    """

    def __init__(self) -> None:
        self._numbers: IntArray = np.zeros(0, dtype=np.int64)
        self._accused: IntArray = np.zeros(0, dtype=np.int64)
        self._old: dict[bytes, FloatArray] = {}
        self._new: dict[bytes, FloatArray] = {}
        self._wave: FloatArray | None = None
        self._learnt_from = 0

    def name(self, numbers: Sequence[int]) -> None:
        """Begin a search among points of these numbers."""
        self._numbers = np.asarray(numbers, dtype=np.int64)
        self._old, self._new = self._new, {}

    def suspects(self) -> BoolArray:
        """Return which points were outliers in the last search, shape (n,)."""
        return np.isin(self._numbers, self._accused)

    def accuse(self, outlier: BoolArray) -> None:
        """Remember the outliers of this search, shape (n,)."""
        self._accused = self._numbers[outlier]

    def wave(self, count: int) -> FloatArray | None:
        """Return the wave of the last search; None where it came from many fewer outliers."""
        return self._wave if count < _GROWTH * self._learnt_from else None

    def hear(self, wave: FloatArray, count: int) -> None:
        """Remember a wave that so many outliers have in common."""
        if self.wave(count) is None:
            self._learnt_from = count
        self._wave = wave

    def keys(self, members: IntArray) -> list[bytes]:
        """Return what stands for each point with its neighbours (n, k)."""
        rows = np.column_stack([self._numbers, self._numbers[members]])
        return [row.tobytes() for row in rows]

    def get(self, key: bytes) -> FloatArray | None:
        """Return what is remembered, None where nothing is."""
        row = self._new.get(key)
        if row is None:
            row = self._old.get(key)
            if row is not None:
                self._new[key] = row
        return row

    def put(self, key: bytes, row: FloatArray) -> None:
        """Remember."""
        self._new[key] = row
