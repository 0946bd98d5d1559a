"""The task that segments the frames, one period at a time.

Frames wait in a bounded queue; a full one drops the oldest and counts it. An update takes the
frames of one period. The numbers of the frames delimit the period, not their times of arrival, so
that the model is the same whether frames come in time or are filled in later. An update waits for
frames that may still be filled in.
"""

import asyncio
from collections.abc import Callable
from time import perf_counter
from typing import TYPE_CHECKING, Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.leader.modelling.stage import Figures, InFlight, Item

if TYPE_CHECKING:
    from mmt.leader.modelling.process import ModellingProcess

LONGEST_QUEUE_S: Final = 10.0
"""Frames of this time may wait, and the work of the updates in this time."""


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
        """Insert frames (n,) in the order of their numbers; return how many were dropped.

        They are sorted once a period is taken, not at each of the many insertions in between.
        """
        if not len(frames):
            return 0
        first, dropped = self.first_sequence, self.put(frames)
        self._ordered = False
        if first is not None and self._first is not None:  # else it is looked up when needed
            self._first = min(first, int(frames["sequence"].min()))
        return dropped

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


class SegmentingTask:
    """Collect frames, and segment them once a period.

    Parameters
    ----------
    period_frames
        Number of frames that a modeller takes at a time.
    rate_hz
        Frames a second.
    keep_frames
        How many frames the follower can send again: this many more may wait.
    in_step
        Whether each update is finished before the next.
    process
        Process that runs the numerics.
    behind
        Counts the items from this task to the end of the pipeline.
    deliver
        Called on the event loop with each item.
    """

    def __init__(
        self,
        period_frames: int,
        rate_hz: float,
        keep_frames: int,
        in_step: bool,
        process: "ModellingProcess",
        behind: InFlight,
        deliver: Callable[[Item], None],
    ) -> None:
        self._period_frames = period_frames
        capacity = max(period_frames, round(LONGEST_QUEUE_S * rate_hz)) + keep_frames
        self._overloaded_frames = capacity - round(LONGEST_QUEUE_S / 2 * rate_hz)
        self._queue = FrameQueue(capacity, least_drop=period_frames)
        self._in_step = in_step
        self._process = process
        self._behind = behind
        self._deliver = deliver
        self._due = asyncio.Event()
        self._generation = 0
        self._newest = -1  # number of the newest frame in an update, or discarded
        self.first: int | None = None
        """Number of the model's first frame, or None before its first update."""
        self.figures = Figures(lambda: len(self._queue))
        self.first_missing: Callable[[], int | None] = lambda: None
        """Returns the smallest number that may still be filled in, or None."""
        self.late_frames = 0
        """Frames that were filled in after an update had gone on without them."""

    @property
    def due(self) -> bool:
        """Whether frames wait that may be enough for an update."""
        return self._due.is_set()

    def put(self, frames: RecordArray) -> None:
        """Queue frames (n,); never blocks."""
        self.figures.drops += self._queue.put(frames)
        self.figures.record_length()
        first = self._queue.first_sequence
        if first is not None and int(frames["sequence"][-1]) - first >= self._period_frames - 1:
            self._due.set()

    def insert(self, frames: RecordArray) -> None:
        """Insert late frames (n,) in the order of their numbers; never blocks."""
        early = frames[frames["sequence"] > self._newest]
        self.late_frames += len(frames) - len(early)
        self.figures.drops += self._queue.insert(early)

    def wake(self) -> None:
        """Check for a due update: some missing frames have come, or will not come."""
        self._due.set()

    def clear(self, newest: int) -> None:
        """Discard the frames up to number `newest`: those that wait, and those filled in later."""
        self._queue.pop_all()
        self._newest = newest

    def discard_work(self) -> None:
        """Discard the work under way."""
        self._generation += 1

    async def run(self) -> None:
        """Segment until cancelled."""
        while True:
            frames = self._next_period()
            if frames is None:
                self._due.clear()
                await self._due.wait()
                continue
            await self._segment(frames)

    async def _segment(self, frames: RecordArray) -> None:
        """Segment the frames of one period, and deliver the resulting work."""
        generation, seconds, started = self._generation, 0.0, perf_counter()
        number: int | None = await self._process.call("segment", frames)
        while number is not None and generation == self._generation:
            now = perf_counter()
            seconds += now - started
            self._behind.add()
            self._deliver(Item(number, now - started))
            if self._in_step:
                await self._behind.wait_until_empty()
            started = perf_counter()
            number = await self._process.call("next_work")
        self.figures.add(seconds + perf_counter() - started)

    def _next_period(self) -> RecordArray | None:
        """Return the frames of the next update, or None if it is not due."""
        if len(self._queue) > self._overloaded_frames:  # updates cannot keep up: make fewer
            frames: RecordArray | None = self._queue.pop_all()
        else:
            frames = self._queue.pop_period(self._period_frames, self.first_missing())
        if frames is not None:
            self._newest = int(frames["sequence"][-1])
            if self.first is None:
                self.first = int(frames["sequence"][0])
        return frames
