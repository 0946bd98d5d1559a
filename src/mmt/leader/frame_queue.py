"""Frames that wait for the next update, in one block of memory."""

import numpy as np

from mmt.arrays import RecordArray


class FrameQueue:
    """A bounded queue of frames; a full one drops the oldest.

    Frames are copied into one array as they come: joining a thousand single frames at the
    end of a period would hold up the event loop for several milliseconds.

    Parameters
    ----------
    capacity
        Most frames that may wait.
    least_drop
        At least so many are dropped at a time, so that a full queue is seldom moved up.
    """

    def __init__(self, capacity: int, least_drop: int) -> None:
        self._capacity = capacity
        self._least_drop = min(least_drop, capacity)
        self._frames: RecordArray | None = None
        self._count = 0

    @property
    def first_sequence(self) -> int | None:
        """The oldest frame's number, None where nothing waits."""
        if self._frames is None or not self._count:
            return None
        return int(self._frames["sequence"][0])

    def put(self, frames: RecordArray) -> int:
        """Queue frames (n,); return how many were dropped."""
        if self._frames is None:
            self._frames = np.empty(self._capacity, dtype=frames.dtype)
        dropped = max(0, len(frames) - self._capacity)
        frames = frames[dropped:]
        excess = self._count + len(frames) - self._capacity
        if excess > 0:
            moved_out = min(self._count, max(excess, self._least_drop))
            self._frames[: self._count - moved_out] = self._frames[moved_out : self._count].copy()
            self._count -= moved_out
            dropped += moved_out
        self._frames[self._count : self._count + len(frames)] = frames
        self._count += len(frames)
        return dropped

    def take_all(self) -> RecordArray:
        """Return what waits, oldest first, and empty the queue."""
        frames = np.empty(0) if self._frames is None else self._frames[: self._count].copy()
        self._count = 0
        return frames
