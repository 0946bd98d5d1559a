"""Bound the growth of a sender's sequence numbers by the receiver's own clock."""

from typing import Final

MARGIN_NS: Final = 2_000_000_000
"""Time by which a sender may be ahead of the clock, as in a burst after a network stall."""

_CATCH_UP_FACTOR: Final = 2
"""How many times faster than its rate a sender may be while it catches up."""


def shortest_period_ns(rate_hz: float, fastest: float) -> int:
    """Return the shortest mean time (ns) between two records.

    Parameters
    ----------
    rate_hz
        Records a second in real time.
    fastest
        How many times faster than real time the sender may stream.
    """
    return max(1, round(1e9 / (rate_hz * fastest * _CATCH_UP_FACTOR)))


def largest_advance(silence_ns: int, shortest_ns: int) -> int:
    """Return how far the sequence numbers may advance during a silence of this length (ns)."""
    return (silence_ns + MARGIN_NS) // shortest_ns


class JumpBound:
    """Bound the growth of sequence numbers by the time that passes at the receiver.

    A token bucket in units of time, filled by the clock. Each number costs the shortest period,
    so that in the long run a sender is at most that fast, and at most two seconds ahead once.
    A silence fills the bucket further; the surplus drains while records arrive, so that a burst
    after a network stall still passes. If the clock jumps back, the bucket moves with it. Takes
    a few integer operations for each record, no division.

    Parameters
    ----------
    shortest_ns
        See `shortest_period_ns`.
    """

    def __init__(self, shortest_ns: int) -> None:
        self._shortest_ns = shortest_ns
        self._drain_ns = 2 * shortest_ns
        self._due_ns = -MARGIN_NS
        self._arrival_ns = 0

    def restart(self, arrival_ns: int) -> None:
        """Start again from the record that arrives now."""
        self._due_ns = arrival_ns - MARGIN_NS
        self._arrival_ns = arrival_ns

    def permits(self, ahead: int, arrival_ns: int) -> bool:
        """Return whether a number this far ahead of the newest is plausible; charge nothing."""
        jumped_ns = max(0, self._arrival_ns - arrival_ns)
        return self._due_ns - jumped_ns + ahead * self._shortest_ns <= arrival_ns

    def allows(self, ahead: int, arrival_ns: int) -> bool:
        """Return whether a number this far ahead of the newest is plausible; if so, charge it."""
        if arrival_ns < self._arrival_ns:
            self._due_ns -= self._arrival_ns - arrival_ns
        self._arrival_ns = arrival_ns
        due_ns = self._due_ns + ahead * self._shortest_ns
        if due_ns > arrival_ns:
            return False
        above_ns = arrival_ns - MARGIN_NS - due_ns
        if above_ns > 0:
            due_ns += above_ns if above_ns < self._drain_ns else self._drain_ns
        self._due_ns = due_ns
        return True
