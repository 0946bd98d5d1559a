"""One ascending numbering of a recorded stream, also where the frames' own starts anew or wraps."""

from typing import Final

import numpy as np

from mmt.core.arrays import IntArray, RecordArray
from mmt.core.frames import SEQUENCES

_LONGEST_GAP: Final = 2**20  # frames, 17 min at 1 kHz, that may be missing where numbers wrap
_GRID: Final = 1000
"""A new run begins on a multiple of it, as the cells of segments and blocks do, so that its own do
not depend on those before it; so do at least as many missing frames."""

_SHORTEST_RUN: Final = 1000  # frames, after which one not above the first is no repeated one
_LATEST: Final = 60_000  # frames behind the newest: no late frame


class StreamNumbering:
    """Number the frames of a stream on.

    A frame with a number that is not above the newest one is one of three. If numbers have
    wrapped, it is the next, and its number is unwrapped. If its time is later than the newest
    frame's, or its number further back than a late frame's, the sender has started anew: the
    frame begins a new run behind the session so far, with missing frames in between, so that no
    segment reaches across. Otherwise it is late or repeated, and its number stays in its run.

    Numbers that ascend pass as they are. Cost: some 3 ns a frame.
    """

    def __init__(self) -> None:
        self._shift = 0
        self._first: int | None = None  # of the run, as the sender has numbered it
        self._newest = -1
        self._newest_time_ns = 0

    def number(self, frames: RecordArray) -> RecordArray:
        """Return the next frames (n,), numbered on; of ``sequence`` i8 where numbers changed."""
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
        """Note the frames of a run from `start` on; return where the next run begins."""
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
