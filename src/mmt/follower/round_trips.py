"""Round trips of commands: measured by their echoes, and how long a silence they excuse."""

from bisect import bisect_left
from typing import Final

from mmt.core.arrays import RecordArray
from mmt.scene import Link

_KEPT: Final = 65_536
"""Least number of frames whose times are kept: a minute of them at 1 kHz."""
_EARLY_NS: Final = 1_000_000
_DRIFT: Final = 1000
"""How far below zero a round trip may be: a fixed time, plus a thousandth of the echo's age for
the drift between two clocks."""
_GAIN: Final = 1 / 8
_DEVIATION_GAIN: Final = 1 / 4
_DEVIATIONS: Final = 4.0
_LEAST_MARGIN_NS: Final = 20_000_000


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


class SilenceLimit:
    """The silence limit, estimated from the round trips of commands.

    TCP sends a lost segment again after a round trip or somewhat more, and later data wait for it:
    a gap of one round trip is one loss, a gap of two is a loss of the repetition too. So the limit
    is two smoothed round trips plus a margin of four deviations, at least 20 ms, by the estimator
    of RFC 6298 (gains 1/8 and 1/4, one sample a round trip). The limit is never below
    ``silence_ms`` and never above ``longest_silence_ms``.

    Parameters
    ----------
    link
        The scene's ``[link]``.
    """

    def __init__(self, link: Link) -> None:
        self._shortest_ns = round(link.silence_ms * 1e6)
        self._longest_ns = round(link.longest_wait_ms * 1e6)
        self._smoothed_ns = self._deviation_ns = 0.0
        self._next_ns: int | None = None
        self.limit_ns = self._shortest_ns

    def add(self, round_trip_ns: int, arrival_ns: int) -> None:
        """Take the round trip of a command, with its arrival by this clock."""
        if self._next_ns is None:
            self._smoothed_ns, self._deviation_ns = float(round_trip_ns), round_trip_ns / 2
        elif arrival_ns < self._next_ns:
            return
        else:
            off_ns = round_trip_ns - self._smoothed_ns
            self._deviation_ns += _DEVIATION_GAIN * (abs(off_ns) - self._deviation_ns)
            self._smoothed_ns += _GAIN * off_ns
        self._next_ns = arrival_ns + round(self._smoothed_ns)
        margin_ns = max(_DEVIATIONS * self._deviation_ns, _LEAST_MARGIN_NS)
        wanted_ns = round(2.0 * self._smoothed_ns + margin_ns)
        self.limit_ns = min(max(wanted_ns, self._shortest_ns), self._longest_ns)
