"""The follower's newest frames, kept for a leader that lacks some of them."""

from collections.abc import Iterable

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.ranges import Range


class KeptFrames:
    """A ring of the newest frames as bytes; about 0.3 us a frame.

    Parameters
    ----------
    dtype
        Of the frames.
    capacity
        How many are kept, at least 1; older ones are overwritten.
    """

    def __init__(self, dtype: np.dtype[np.void], capacity: int) -> None:
        self._size = dtype.itemsize
        self._bytes = bytearray(capacity * self._size)
        self._frames: RecordArray = np.frombuffer(self._bytes, dtype=dtype)
        self._place = 0
        self._full = False

    def __len__(self) -> int:
        """Return how many frames are kept."""
        return len(self._frames) if self._full else self._place // self._size

    def put(self, data: bytes) -> None:
        """Keep whole frames, newest last, in place of the oldest."""
        data = data[-len(self._bytes) :]
        stop = self._place + len(data)
        over = stop - len(self._bytes)
        if over < 0:
            self._bytes[self._place : stop] = data
            self._place = stop
            return
        self._bytes[self._place :] = data[: len(data) - over]
        self._bytes[:over] = data[len(data) - over :]
        self._place = over
        self._full = True

    def select(self, ranges: Iterable[Range]) -> RecordArray:
        """Return a copy of the frames (n,) whose numbers lie in the ranges, ascending, each once.

        A fraction of a millisecond for 10,000 frames.
        """
        kept = self._frames[: len(self)]
        numbers = kept["sequence"].astype(np.int64)
        order = np.argsort(numbers, kind="stable")
        numbers = numbers[order]
        chosen = [
            order[numbers.searchsorted(first) : numbers.searchsorted(stop)]
            for first, stop in ranges
        ]
        if not chosen:
            return kept[:0].copy()
        frames = kept[np.concatenate(chosen)]
        _, firsts = np.unique(frames["sequence"], return_index=True)
        return frames[firsts]
