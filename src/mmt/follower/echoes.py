"""The age of a command, from its echo of a frame that the follower has sent."""

from bisect import bisect_left
from typing import Final

from mmt.core.arrays import RecordArray

_KEPT: Final = 65_536
"""Least number of frames whose times are kept: a minute of them at 1 kHz."""
_EARLY_NS: Final = 1_000_000
_DRIFT: Final = 1000
"""How far below zero a round trip may be: a fixed time, plus a thousandth of the echo's age for
the drift between two clocks."""


class EchoCheck:
    """Remember the times of the frames sent, and compute the round trip of a command from them.

    The echo comes from the other side and is not trusted: this side's clock and frames must
    confirm it. About 1 us a frame and 1 us a command.
    """

    def __init__(self) -> None:
        self._times_ns: list[int] = []
        self._first_ns: int | None = None

    def connect(self) -> None:
        """Prepare for a connection, whose leader has received no frame yet."""
        self._times_ns.clear()
        self._first_ns = None

    def note(self, frames: RecordArray) -> None:
        """Note frames (n,), n >= 1, that are about to be sent."""
        added_ns, times_ns = frames["time_ns"].tolist(), self._times_ns
        if times_ns and added_ns[0] < times_ns[-1]:
            times_ns.clear()  # the frames' clock has jumped back
        times_ns += added_ns
        if len(times_ns) > 2 * _KEPT:
            del times_ns[:-_KEPT]
        if self._first_ns is None:
            self._first_ns = added_ns[0]

    def round_trip_ns(self, echo_time_ns: int, echo_age_ns: int, arrival_ns: int) -> int | None:
        """Return the round trip of a command (ns), or None if its echo is impossible.

        Parameters
        ----------
        echo_time_ns
            Time of the echoed frame, which must have been noted; 0 if the leader had no frame yet.
            The round trip is then taken from the first frame.
        echo_age_ns
            How long the leader had had that frame.
        arrival_ns
            When the command arrived.
        """
        if echo_time_ns == 0:
            return 0 if self._first_ns is None else arrival_ns - self._first_ns
        place = bisect_left(self._times_ns, echo_time_ns)
        if echo_age_ns < 0 or self._times_ns[place : place + 1] != [echo_time_ns]:
            return None
        round_trip_ns = arrival_ns - echo_time_ns - echo_age_ns
        earliest_ns = -_EARLY_NS - echo_age_ns // _DRIFT
        return round_trip_ns if round_trip_ns >= earliest_ns else None
