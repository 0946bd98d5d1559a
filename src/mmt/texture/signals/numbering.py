"""One ascending numbering of a stream, even if the frames' own numbers restart or wrap."""

from typing import Final

import numpy as np

from mmt.core.arrays import IntArray, RecordArray
from mmt.core.sequence_numbers import SEQUENCES

_LONGEST_GAP: Final = 2**20  # frames, 17 min at 1 kHz, that may be missing at a wrap
_GRID: Final = 1000
"""A new run begins at a multiple of it, after at least as many missing frames. Cells of segments
and blocks lie on the same grid, so that those of a run do not depend on earlier runs."""

_SHORTEST_RUN: Final = 1000  # frames; after them a number not above the first is no repetition
_LATEST: Final = 60_000  # frames behind the newest; a number further back is no late frame


class StreamNumbering:
    """Continue the numbering of a stream across restarts and wraps of the frames' numbers.

    A number that is not above the newest one has one of three reasons. If numbers have wrapped,
    it is unwrapped. If the frame's time is later than the newest frame's, or its number further
    back than a late frame's, the sender has restarted: the frame begins a new run after the
    session so far, with missing frames in between, so that no segment spans both. Otherwise the
    frame is late or repeated, and its number stays in its run.

    Ascending numbers stay as they are. Cost: some 3 ns a frame.
    """

    def __init__(self) -> None:
        self._shift = 0
        self._first: int | None = None  # of the run, as the sender has numbered it
        self._newest = -1
        self._newest_time_ns = 0

    def number(self, frames: RecordArray) -> RecordArray:
        """Return the next frames (n,), renumbered; ``sequence`` is i8 if numbers changed."""
        if not len(frames):
            return frames
        own, times_ns = frames["sequence"].astype(np.int64), frames["time_ns"]
        if self._first is None:
            self._first, self._newest = int(own[0]), int(own[0]) - 1
        shifts = np.full(len(own), self._shift)
        start = 0
        while start < len(own):
            start = self._pass_run(own, times_ns, start)
            if start < len(own):
                self._begin_run(int(own[start]))
                shifts[start:] = self._shift
        if not shifts.any():
            return frames
        names = [(name, frames.dtype[name]) for name in frames.dtype.names or ()]
        kept = [("sequence", np.dtype(np.int64)) if n == "sequence" else (n, d) for n, d in names]
        numbered = frames.astype(np.dtype(kept))
        numbered["sequence"] = own + shifts
        return numbered

    def _pass_run(self, own: IntArray, times_ns: IntArray, start: int) -> int:
        """Record the frames of a run from `start` on; return the start of the next run."""
        newest = np.maximum.accumulate(np.concatenate([[self._newest], own[start:]]))
        behind = np.flatnonzero(own[start:] <= newest[:-1]) + start
        for at in behind.tolist():
            before = int(newest[at - start])
            time_ns = self._newest_time_ns
            if before > self._newest:
                time_ns = int(times_ns[start + int(np.argmax(own[start:at] == before))])
            number, first = int(own[at]), self._first or 0
            wrapped = _has_wrapped(before, number)
            back = number <= first and before >= first + _SHORTEST_RUN
            if wrapped or back or before - number > _LATEST or int(times_ns[at]) > time_ns:
                self._note(own, times_ns, start, at)
                return at
        self._note(own, times_ns, start, len(own))
        return len(own)

    def _note(self, own: IntArray, times_ns: IntArray, start: int, stop: int) -> None:
        if stop > start and int(own[start:stop].max()) >= self._newest:
            at = start + int(np.argmax(own[start:stop]))
            self._newest, self._newest_time_ns = int(own[at]), int(times_ns[at])

    def _begin_run(self, number: int) -> None:
        """Shift the numbers from here on: unwrapped, or on the grid behind the newest frame."""
        if _has_wrapped(self._newest, number):
            self._shift += SEQUENCES
        else:
            behind = self._newest + self._shift + 1
            self._shift = -(-(behind + _GRID) // _GRID) * _GRID - number
        self._first, self._newest = number, number - 1


def _has_wrapped(newest: int, number: int) -> bool:
    return newest >= SEQUENCES - _LONGEST_GAP and number < _LONGEST_GAP
