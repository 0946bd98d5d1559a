"""Cache between successive searches for outliers among mostly the same points."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray

_GROWTH: Final = 1.25  # of the number of outliers, from which their blow is searched for anew


class SearchCache:
    """Results of earlier searches: outliers, bursts by segment and neighbours, the knock waveform.

    A search starts without the last one's outliers and tests them at its end. `begin` sets the
    numbers of the points of the next search; entries that two successive searches have not used
    are dropped.
    """

    def __init__(self) -> None:
        self._numbers: IntArray = np.zeros(0, dtype=np.int64)
        self._accused: IntArray = np.zeros(0, dtype=np.int64)
        self._old: dict[bytes, FloatArray] = {}
        self._new: dict[bytes, FloatArray] = {}
        self._wave: FloatArray | None = None
        self._learnt_from = 0

    def begin(self, numbers: Sequence[int]) -> None:
        """Begin a search among points of the given numbers."""
        self._numbers = np.asarray(numbers, dtype=np.int64)
        self._old, self._new = self._new, {}

    def suspects(self) -> BoolArray:
        """Return which points were outliers in the last search, shape (n,)."""
        return np.isin(self._numbers, self._accused)

    def put_outliers(self, outlier: BoolArray) -> None:
        """Store the mask of outliers of this search, shape (n,)."""
        self._accused = self._numbers[outlier]

    def wave(self, count: int) -> FloatArray | None:
        """Return the last waveform; None if it was estimated from many fewer outliers."""
        return self._wave if count < _GROWTH * self._learnt_from else None

    def put_wave(self, wave: FloatArray, count: int) -> None:
        """Store a waveform estimated from `count` outliers."""
        if self.wave(count) is None:
            self._learnt_from = count
        self._wave = wave

    def keys(self, members: IntArray) -> list[bytes]:
        """Return a key for each point with its neighbours (n, k)."""
        rows = np.column_stack([self._numbers, self._numbers[members]])
        return [row.tobytes() for row in rows]

    def get(self, key: bytes) -> FloatArray | None:
        """Return the cached row of a key, None if absent."""
        row = self._new.get(key)
        if row is None:
            row = self._old.get(key)
            if row is not None:
                self._new[key] = row
        return row

    def put(self, key: bytes, row: FloatArray) -> None:
        """Cache a row under a key."""
        self._new[key] = row
