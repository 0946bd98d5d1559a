"""Missing frames: accounted for, requested again, and passed to those that can use them."""

import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.sequence_numbers import SEQUENCES, Range, RangeSet
from mmt.leader.numbering import SessionNumbering

if TYPE_CHECKING:
    from mmt.link.protocol import FollowerHello


PERIOD_TICKS: Final = 50
"""Time between two checks for gaps to record and to request."""

AGAIN_TICKS: Final = 1000
"""Time after which a range is requested again if it has not come: a lossy link loses answers too,
even while other answers come."""

LEAST_PATIENCE_TICKS: Final = 3000
"""Time without an answer after which frames are given up; longer if the follower buffers more.

A link that is stalled, or that has time for live frames only, does not answer either.
"""

MOST_RANGES: Final = 200
"""Most ranges that are waited for; beyond it the oldest are given up, so that a bad link cannot
hold the modelling up. No more are requested at a time."""

WORTH_SAYING: Final = 100
"""Gaps of fewer frames are recorded but not announced."""


class Note(Protocol):
    """Records an event, and announces it to the user if wanted."""

    def __call__(self, sentence: str, *, announce: bool, **details: object) -> None:
        """Record a sentence, with details for programs."""


@dataclass
class _Gap:
    first: int
    stop: int
    lost: int = 0


class MissingFrames:
    """Keep account of missing frames, in the session's numbering.

    A jump in the numbers of the live frames is a gap. A gap is recorded first, then requested.
    Each frame is accepted once. Frames that the follower no longer keeps, or does not send in
    time, count as lost, unless they come after all. Time is counted in the leader's ticks while
    the follower is connected; no clock is read.

    Parameters
    ----------
    most
        Most frames of a gap to request; the newest ones are requested.
    ask
        Called with the missing ranges of numbers to request.
    note
        Called to record a gap, and to record that it is closed.
    """

    def __init__(self, most: int, ask: Callable[[list[Range]], None], note: Note) -> None:
        self._most = most
        self._ask = ask
        self._note = note
        self._keeps = 0  # frames that the connected follower buffers
        self._missing, self._given_up = RangeSet(), RangeSet()
        self._unasked = RangeSet()
        self._asked: deque[tuple[int, list[Range]]] = deque()  # with the time, oldest first
        self._unnoted: list[Range] = []
        self._gaps: list[_Gap] = []
        self._idle_ticks = self._ticks = self._now_ticks = 0
        self._resolved = False
        self._seen = self._filled = self._lost = self._late = self._unwanted = 0

    @property
    def first(self) -> int | None:
        """The smallest number that may still come, or None if no frame is missing."""
        return self._missing.first

    @property
    def summary(self) -> dict[str, int]:
        """Numbers of frames missing, filled in, lost, still awaited, and received unasked."""
        return {
            "missing": self._seen,
            "filled": self._filled,
            "lost": self._lost,
            "waiting": self._missing.count,
            "unwanted": self._unwanted,
        }

    def connect(self, keep_frames: int) -> None:
        """Note a follower that buffers this many frames; request all that did not come."""
        self._keeps = min(keep_frames, self._most)
        self._unasked = RangeSet(self.outstanding())
        self._asked.clear()
        self._idle_ticks = 0

    def give_up_all(self) -> None:
        """Give up all missing frames, for instance if the follower that had them is gone."""
        self._lose(list(self._missing))

    def add_unsent(self, frames: int) -> None:
        """Count frames as lost that were never sent: no follower ran, and none may still come."""
        self._given_up.clear()
        self._seen += frames
        self._lost += frames

    def jumped(self, newest: int, frames: RecordArray) -> None:
        """Note the gaps within frames (n,), and between them and the newest frame before."""
        before = newest
        for number in frames["sequence"].tolist():
            if number > before + 1:
                self.add_gap(before + 1, number)
            before = number

    def add_gap(self, first: int, stop: int) -> None:
        """Note that the numbers from `first` up to `stop` did not arrive."""
        self._seen += stop - first
        self._gaps.append(_Gap(first, stop))
        self._unnoted.append((first, stop))
        self._missing.add(first, stop)
        self._unasked.add(first, stop)
        if stop - first > self._keeps:
            self._lose([(first, stop - self._keeps)])
        while len(self._missing) > MOST_RANGES:
            self._lose([next(iter(self._missing))])

    def take_missing(self, frames: RecordArray) -> RecordArray:
        """Return the frames (n,) that are missing or given up, ascending; they are filled in."""
        numbers = frames["sequence"].tolist()
        late, timely = (
            np.array([ranges.remove(n, n + 1) for n in numbers], bool)
            for ranges in (self._given_up, self._missing)
        )
        taken: RecordArray = frames[late | timely]
        come_late = int(np.count_nonzero(late))
        self._late += come_late
        self._lost -= come_late
        self._unwanted += len(frames) - len(taken)
        if len(taken):
            self._filled += len(taken)
            self._idle_ticks = 0
            self._resolved = True
            taken = taken[np.argsort(taken["sequence"])]
        return taken

    def give_up(self, ranges: list[Range]) -> None:
        """Give up ranges that the follower does not have."""
        self._idle_ticks = 0
        self._lose(ranges)
        for first, stop in ranges:
            self._given_up.remove(first, stop)

    def tick(self, elapsed: int) -> bool:
        """Record, request and give up what is due; return whether frames came or were given up."""
        self._ticks += elapsed
        if self._ticks < PERIOD_TICKS:
            return False
        self._ticks = 0
        self._now_ticks += PERIOD_TICKS
        if self._unnoted:
            self._note_gaps()
        if self._missing:
            self._idle_ticks += PERIOD_TICKS
            if self._idle_ticks >= max(self._keeps, LEAST_PATIENCE_TICKS):
                self.give_up_all()
        self._ask_for_missing()
        closed, self._resolved = self._resolved, False
        if closed:
            self._note_closed()
        return closed

    def close(self) -> None:
        """Give up all missing frames and record this, at the end of the session."""
        if self._unnoted:
            self._note_gaps()
        self.give_up_all()
        self._note_closed()

    def outstanding(self) -> list[Range]:
        """Return the ranges that did not come, to be requested at the end of a session."""
        self._unasked.clear()
        return [*self._missing, *self._given_up]

    def _ask_for_missing(self) -> None:
        """Request ranges that were not requested yet, or so long ago that the answer is lost."""
        while self._asked and self._now_ticks - self._asked[0][0] >= AGAIN_TICKS:
            for asked in self._asked.popleft()[1]:
                for first, stop in self._missing.within(*asked):
                    self._unasked.add(first, stop)
        if self._unasked:
            ranges = list(self._unasked)[:MOST_RANGES]
            self._asked.append((self._now_ticks, ranges))
            self._ask(ranges)
            for first, stop in ranges:
                self._unasked.remove(first, stop)

    def _lose(self, ranges: list[Range]) -> None:
        for first, stop in ranges:
            for low, high in self._missing.within(first, stop):
                self._lose_of_gaps(low, high)
                self._given_up.add(low, high)
            self._lost += self._missing.remove(first, stop)
            self._unasked.remove(first, stop)
        while len(self._given_up) > self._keeps:  # the follower does not keep more
            self._given_up.remove(*next(iter(self._given_up)))
        self._resolved = True

    def _lose_of_gaps(self, low: int, high: int) -> None:
        """Count numbers as lost in the gaps that contain them; gaps ascend without overlap."""
        place = bisect_right(self._gaps, low, key=lambda gap: gap.stop)
        while place < len(self._gaps) and self._gaps[place].first < high:
            gap = self._gaps[place]
            gap.lost += min(high, gap.stop) - max(low, gap.first)
            place += 1

    def _note_gaps(self) -> None:
        ranges, self._unnoted = self._unnoted, []
        frames = sum(stop - first for first, stop in ranges)
        self._note(
            f"{frames} frames are missing",
            announce=frames >= WORTH_SAYING,
            kind="gap",
            frames=frames,
            ranges=ranges,
        )

    def _note_closed(self) -> None:
        """Record the gaps of which no frame is awaited any more, and frames that came later."""
        late, self._late = self._late, 0
        if late:
            self._note(
                f"{late} frames that were given up have come",
                announce=late >= WORTH_SAYING,
                kind="filled",
                frames=0,
                lost=-late,
            )
        closed: list[_Gap] = []
        open_still: list[_Gap] = []
        for gap in self._gaps:
            waits = bool(self._missing.within(gap.first, gap.stop))
            (open_still if waits else closed).append(gap)
        if not closed:
            return
        self._gaps = open_still
        frames = sum(gap.stop - gap.first for gap in closed)
        lost = sum(gap.lost for gap in closed)
        parts = [f"{frames - lost} are filled in"] if frames > lost else []
        parts += [f"{lost} are lost"] if lost else []
        self._note(
            f"of the missing frames {', '.join(parts)}",
            announce=frames >= WORTH_SAYING,
            kind="filled",
            frames=frames,
            lost=lost,
            ranges=[(gap.first, gap.stop) for gap in closed],
        )


class Backfill:
    """Request missing frames from the follower, and pass them to the parts that can use them.

    The recorder takes every frame. Modelling takes a frame unless it has gone on without this
    frame. Playout and force feedback never get a frame that was filled in.

    Parameters
    ----------
    keep_frames
        Most frames of a gap to request, 0 for none.
    numbering
        Numbering of the session; the follower has numbers of its own.
    call
        Calls a verb of every part, to pass on the frames that were missing.
    request
        Requests ranges of the follower's own numbers from the follower.
    note
        Records an event.
    """

    def __init__(
        self,
        keep_frames: int,
        numbering: SessionNumbering,
        call: Callable[..., None],
        request: Callable[[list[Range]], None],
        note: Note,
    ) -> None:
        self._numbering = numbering
        self._call = call
        self.missing = MissingFrames(keep_frames, lambda ranges: request(self._own(ranges)), note)
        self.settled = False
        """Whether the follower is about to end, so that no frame is live any more."""

    @property
    def summary(self) -> dict[str, Any]:
        """Counts so far, by name; empty if no frame was ever missing."""
        return self.missing.summary if self.missing.summary["missing"] else {}

    def connect(self, hello: "FollowerHello") -> None:
        """Note the follower that is connected from now on."""
        self.settled = False
        if self._numbering.anew:
            self.restart()
        self.missing.connect(hello.keep_frames)

    def restart(self, skipped: int = 0) -> None:
        """Give up frames that the earlier follower had buffered, and those between the two."""
        self.missing.give_up_all()
        self.missing.add_unsent(skipped)
        self._call("on_settled")

    def receive(self, frames: RecordArray) -> None:
        """Handle frames (n,) that were sent again, in the follower's numbers."""
        frames = self.missing.take_missing(self._numbering.renumber(frames))
        if not len(frames):
            return
        arrival_ns = self._numbering.expected_arrival_ns(
            int(frames["time_ns"][0]), time.monotonic_ns()
        )
        self._call("on_backfill", frames, arrival_ns)

    def give_up(self, ranges: list[Range]) -> None:
        """Give up ranges of frames, in the follower's numbers."""
        self.missing.give_up([self._of_session(first, stop) for first, stop in ranges])
        self._call("on_settled")

    def missing_ranges(self, sent: int) -> list[Range]:
        """Return the missing ranges of the numbers below `sent`, both in the follower's numbers."""
        newest = self._numbering.newest
        stop = self._numbering.of_session(sent)
        if newest >= 0 and stop > newest + 1:
            self.missing.add_gap(newest + 1, stop)
            self._numbering.extend(stop)
        self.settled = True
        return self._own(self.missing.outstanding())

    def tick(self, elapsed: int) -> None:
        """Request and give up frames if it is time; call this while the follower is connected."""
        if self.missing.tick(elapsed):
            self._call("on_settled")

    def close(self) -> None:
        """Stop waiting for frames: the session is over."""
        self.missing.close()
        self._call("on_settled")

    def _own(self, ranges: list[Range]) -> list[Range]:
        """Return ranges in the follower's numbers, without frames from before its start."""
        shift, own = self._numbering.shift, []
        for first, stop in ranges:
            start, end = max(first - shift, 0), stop - shift
            while start < end:  # in parts, if its numbers wrap in between
                part = min(end, (start // SEQUENCES + 1) * SEQUENCES)
                own.append((start % SEQUENCES, (part - 1) % SEQUENCES + 1))
                start = part
        return own

    def _of_session(self, first: int, stop: int) -> Range:
        """Return the session's range for a follower's; it begins at the newest number at most."""
        start = self._numbering.of_session(first)
        start -= SEQUENCES * (start > self._numbering.newest)
        return start, start + stop - first
