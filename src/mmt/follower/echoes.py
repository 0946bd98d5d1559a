"""How old a command is, judged by its echo of a frame that the follower has sent."""

from bisect import bisect_left
from typing import Final

from mmt.core.arrays import RecordArray

_KEPT: Final = 65_536
"""Least number of frames whose times are kept: a minute of them at 1 kHz."""
_EARLY_NS: Final = 1_000_000
_DRIFT: Final = 1000
"""How far below zero a round trip may be: a fixed time, and a thousandth of the echo's age, for
two clocks that do not run alike."""


class EchoCheck:
    """Know the times of the frames sent, and tell the round trip of a command by them.

    The echo comes from the other side, so that it is believed only as far as this side's clock
    and frames bear it out. About 1 us a frame and 1 us a command.
    """

    def __init__(self) -> None:
        self._times_ns: list[int] = []
        self._first_ns: int | None = None

    def connect(self) -> None:
        """Expect a leader that knows no frame."""
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
        """Return the round trip of a command, None where its echo cannot be true.

        Parameters
        ----------
        echo_time_ns
            Time of the frame that it echoes, which must be one that was noted; 0 where the leader
            had none: the round trip then is that of the first one at least.
        echo_age_ns
            How long the leader had had it.
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
