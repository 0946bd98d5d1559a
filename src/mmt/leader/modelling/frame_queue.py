"""Frames that wait for the next update, in one block of memory."""

import numpy as np

from mmt.core.arrays import RecordArray


class FrameQueue:
    """A bounded queue of frames; a full one drops the oldest.

    Frames are copied into one array as they come: joining a thousand single frames at the
    end of a period would block the event loop for several milliseconds.

    Parameters
    ----------
    capacity
        Most frames that may wait.
    least_drop
        Fewest frames dropped at a time, so that a full queue seldom moves its frames up.
    """

    def __init__(self, capacity: int, least_drop: int) -> None:
        self._capacity = capacity
        self._least_drop = min(least_drop, capacity)
        self._frames: RecordArray | None = None
        self._count = 0
        self._ordered = True
        self._first: int | None = None  # cached number of the oldest frame

    def __len__(self) -> int:
        """Return how many frames wait."""
        return self._count

    @property
    def first_sequence(self) -> int | None:
        """The number of the oldest frame, or None if the queue is empty."""
        if self._first is None and self._count:
            self._first = int(self._in_order()["sequence"][0])
        return self._first

    def put(self, frames: RecordArray) -> int:
        """Append frames (n,) to the queue; return how many were dropped."""
        if self._frames is None:
            self._frames = np.empty(self._capacity, dtype=frames.dtype)
        dropped = max(0, len(frames) - self._capacity)
        frames = frames[dropped:]
        excess = self._count + len(frames) - self._capacity
        if excess > 0:
            moved_out = min(self._count, max(excess, self._least_drop))
            self._in_order()
            self._remove(moved_out)
            dropped += moved_out
        self._frames[self._count : self._count + len(frames)] = frames
        self._count += len(frames)
        return dropped

    def insert(self, frames: RecordArray) -> int:
        """Insert frames (n,) in the order of their numbers; return how many were dropped."""
        self._ordered, self._first = False, None
        return self.put(frames)

    def pop_period(self, numbers: int, before: int | None) -> RecordArray | None:
        """Remove and return the frames of one period, or None while some may still come.

        Parameters
        ----------
        numbers
            Length of the period, from the oldest frame on; missing frames count.
        before
            Number of the first missing frame that may still come, or None. A period that
            contains this number is not returned.
        """
        waiting = self._in_order()
        if not len(waiting):
            return None
        sequence = waiting["sequence"]
        stop = int(sequence.searchsorted(int(sequence[0]) + numbers - 1)) + 1
        if stop > len(waiting) or (before is not None and before <= int(sequence[stop - 1])):
            return None
        frames = waiting[:stop].copy()
        self._remove(stop)
        return frames

    def pop_all(self) -> RecordArray:
        """Remove and return all frames, oldest first."""
        frames = self._in_order().copy()
        self._count, self._first = 0, None
        return frames

    def _remove(self, count: int) -> None:
        """Remove the `count` oldest frames."""
        if self._frames is not None:
            self._frames[: self._count - count] = self._frames[count : self._count].copy()
            self._count -= count
            self._first = None

    def _in_order(self) -> RecordArray:
        if self._frames is None:
            return np.empty(0)
        waiting = self._frames[: self._count]
        if not self._ordered:
            waiting[:] = waiting[np.argsort(waiting["sequence"], kind="stable")]
            self._ordered = True
        return waiting
