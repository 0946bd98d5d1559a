"""Request missing frames from the follower, for the recording and the model only."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from mmt.core.arrays import RecordArray
from mmt.core.frames import SEQUENCES
from mmt.core.sequence_numbers import Range
from mmt.leader.missing import MissingFrames, Note
from mmt.leader.numbering import SessionNumbering

if TYPE_CHECKING:
    from mmt.link.protocol import FollowerHello


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
        self._request = request
        self.missing = MissingFrames(keep_frames, self._ask, note)
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
        self._report_settled()

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
        self._report_settled()

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
            self._report_settled()

    def close(self) -> None:
        """Stop waiting for frames: the session is over."""
        self.missing.close()
        self._report_settled()

    def _ask(self, ranges: list[Range]) -> None:
        self._request(self._own(ranges))

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

    def _report_settled(self) -> None:
        self._call("on_settled")
