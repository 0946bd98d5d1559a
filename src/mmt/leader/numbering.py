"""One numbering for a session, whatever its follower does, and the rate that its numbers show."""

from collections.abc import Callable
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.sequence_numbers import SEQUENCES, largest_advance, shortest_period_ns, steps_ahead

_SAME_CLOCK_NS: Final = 1_000_000_000
"""Times that differ from the expected time by more than this come from another clock."""
_WINDOW_NS: Final = 1_000_000_000
"""Length of a window: a wrong rate is off alike in two, a stall is made up in the second."""
_TOLERANCE: Final = 0.05


class SessionNumbering:
    """Number the frames of a session consecutively, whichever process sends them.

    A follower that reconnects continues its numbers, and its frames pass unchanged. A restarted
    follower numbers from 0, or from further ahead than the elapsed time allows. The elapsed time
    counts from the newest frame; if the follower is known to be the same process, from the
    session's first, because a paused leader reads old frames late. The frames of a restarted
    follower are placed after those of the session, with a gap as long as the silence, at least one
    frame. So they do not count as late or repeated, and the gap is recorded. If the follower has
    another clock, its times are shifted too. The same is done if a follower restarts its numbers
    while it is connected.

    A follower's numbers may wrap; those of the session never do. They begin with the follower's
    first number, or with 0 if that is in the upper half of the numbers.

    Parameters
    ----------
    period_ns
        Time from frame to frame.
    fastest
        How many times faster than real time a follower may stream.
    """

    def __init__(self, period_ns: int, fastest: float = 1.0) -> None:
        self._period_ns = period_ns
        self._shortest_ns = shortest_period_ns(1e9 / period_ns, fastest)
        self._first: int | None = None
        self.newest = -1
        """The newest frame's number, -1 before the first."""
        self._newest_time_ns = 0
        self._first_arrival_ns = 0
        self._reconnected = False
        self._same = False
        self.anew = False
        """Whether the connected follower is known to be another process than the one before."""
        self._run_id = ""
        self.shift = 0
        """The session's numbers minus those of the connected follower."""
        self._time_shift_ns = 0
        self.follower_time_ns = 0
        """The newest frame's time by the follower's own clock; 0 before the first of each
        connection, since another follower may have another clock."""
        self.arrival_ns = 0
        """When the newest frame arrived; 0 before the first."""

    @property
    def frames(self) -> int:
        """Number of frames from the session's first to its newest, missing ones included."""
        return 0 if self._first is None else self.newest + 1 - self._first

    def reconnect(self, run_id: str = "") -> None:
        """Prepare for a connection of the same follower or of another one.

        Parameters
        ----------
        run_id
            Identifies the follower's process. If empty, the follower's numbers decide whether it
            is the same one.
        """
        self._reconnected = self._first is not None
        known = bool(run_id and self._run_id)
        self._same, self.anew = known and run_id == self._run_id, known and run_id != self._run_id
        self._run_id = run_id
        self.follower_time_ns = 0

    def number(self, frames: RecordArray, arrival_ns: int) -> tuple[RecordArray, int]:
        """Return the next frames (n,), n >= 1, in the session's numbers, and the numbers left out.

        The second value is 0 unless a restarted follower begins here; then it is the number of
        frames that are missing between the session so far and this follower.
        """
        left_out, sequence = 0, int(frames["sequence"][0])
        if self._first is None:
            self.shift = -sequence if sequence >= SEQUENCES // 2 else 0
            self._first, self._first_arrival_ns = sequence + self.shift, arrival_ns
        elif self._reconnected or steps_ahead(sequence, self.newest - self.shift) <= 0:
            self._reconnected = False
            left_out = self._go_on(sequence, int(frames["time_ns"][0]), arrival_ns)
        self.follower_time_ns = int(frames["time_ns"][-1])
        self.arrival_ns = arrival_ns
        frames = self.renumber(frames)
        self.newest = int(frames["sequence"][-1])
        self._newest_time_ns = int(frames["time_ns"][-1])
        return frames, left_out

    def renumber(self, frames: RecordArray) -> RecordArray:
        """Return frames (n,) of the connected follower, in the session's numbers and times."""
        if self.shift or self._time_shift_ns:
            frames = frames.copy()
            own = frames["sequence"].astype(np.int64)
            frames["sequence"] = self.newest + steps_ahead(own, self.newest - self.shift)
            frames["time_ns"] += self._time_shift_ns
        return frames

    def of_session(self, number: int) -> int:
        """Return the session's number for a number of the connected follower."""
        return self.newest + steps_ahead(number, self.newest - self.shift)

    def extend(self, stop: int) -> None:
        """Extend the session's numbers up to `stop`, for frames that are missing at the end."""
        if self._first is not None:
            self.newest = max(self.newest, stop - 1)

    def expected_arrival_ns(self, time_ns: int, now_ns: int) -> int:
        """Return when a frame of this time would have arrived, judged by the newest frame."""
        arrival_ns = self.arrival_ns - (self._newest_time_ns - time_ns)
        return min(max(arrival_ns, 0), now_ns)

    def _go_on(self, sequence: int, time_ns: int, arrival_ns: int) -> int:
        ahead = steps_ahead(sequence, self.newest - self.shift)
        silence_ns = arrival_ns - self.arrival_ns
        most = largest_advance(silence_ns, self._shortest_ns)
        if self._same:
            passed_ns = arrival_ns - self._first_arrival_ns
            most = largest_advance(passed_ns, self._shortest_ns) - self.frames
        if not self.anew and 0 < ahead <= most:
            return 0
        missing = max(1, round(silence_ns / self._period_ns))
        self.shift = self.newest + 1 + missing - sequence
        expected_ns = self._newest_time_ns + (missing + 1) * self._period_ns
        behind_ns = expected_ns - time_ns
        self._time_shift_ns = behind_ns if abs(behind_ns) > _SAME_CLOCK_NS else 0
        return missing


class FrameRateWatch:
    """Measure the rate of frames, and report if it is off by more than 5 % over two seconds.

    The rate follows from sequence numbers and time stamps. Lost frames therefore count and times
    of arrival do not: a network that stalls or loses frames does not change the rate.

    Parameters
    ----------
    promised_hz
        Frames a second, as in the follower's hello.
    say
        Called with a sentence when the rate is found to be off, and when it is right again.
    """

    def __init__(self, promised_hz: float, say: Callable[[str], None]) -> None:
        self._promised_hz = promised_hz
        self._say = say
        self._start: tuple[int, int] | None = None
        self._last_hz = promised_hz
        self.fault: str | None = None
        """The sentence while the rate is off, else None."""

    def restart(self) -> None:
        """Prepare for a new connection."""
        self._start, self._last_hz, self.fault = None, self._promised_hz, None

    def add(self, number: int, time_ns: int) -> None:
        """Take the newest frame's number and its own time, by the follower's clock."""
        if self._start is None or time_ns < self._start[1]:  # the first, or its clock jumped back
            self._start = number, time_ns
        first, start_ns = self._start
        passed_ns = time_ns - start_ns
        if passed_ns >= _WINDOW_NS:
            self._start = number, time_ns
            self._judge(1e9 * (number - first) / passed_ns)

    def _judge(self, rate_hz: float) -> None:
        """Compare the rates of the last two windows with the promised rate."""
        last_hz, self._last_hz = self._last_hz, rate_hz
        off, last_off = self._off(rate_hz), self._off(last_hz)
        if self.fault is not None and not off:
            self.fault = None
            self._say(f"frames come at the {self._promised_hz:g} Hz that the follower promised")
        elif self.fault is None and off and off == last_off:
            self.fault = (
                f"the follower promised {self._promised_hz:g} frames a second and sends "
                f"{(rate_hz + last_hz) / 2:.0f}: have it keep its schedule"
            )
            self._say(self.fault)

    def _off(self, rate_hz: float) -> int:
        """Return the direction in which a rate is off, 0 if it is right."""
        relative = rate_hz / self._promised_hz
        return (relative > 1.0 + _TOLERANCE) - (relative < 1.0 - _TOLERANCE)
