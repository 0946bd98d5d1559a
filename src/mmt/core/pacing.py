"""How far a sender's numbers can have come, by the receiver's own clock."""

from typing import Final

MARGIN_NS: Final = 2_000_000_000
"""Time that a sender may be ahead of the clock: what a network held back comes in a clump."""

_HASTE: Final = 2
"""A sender that catches up may be so many times faster than its pace."""


def shortest_period_ns(rate_hz: float, fastest: float) -> int:
    """Return the least time a record may take on average.

    Parameters
    ----------
    rate_hz
        Records a second in real time.
    fastest
        How many times faster than real time the sender may stream.
    """
    return max(1, round(1e9 / (rate_hz * fastest * _HASTE)))


def most_ahead(silence_ns: int, shortest_ns: int) -> int:
    """Return by how much the sequence numbers may grow within so long a silence."""
    return (silence_ns + MARGIN_NS) // shortest_ns


class JumpBound:
    """Bound the growth of sequence numbers by the time that passes here.

    A bucket of time that fills with the clock. Each number takes its shortest period out, so
    that over any time a sender is at most as fast as that, and two seconds ahead once. After a
    silence the bucket holds as much more; that drains while records come, a clump that a
    network held back passes nevertheless. Some integer operations a record, no division.

    Parameters
    ----------
    shortest_ns
        See `shortest_period_ns`.
    """

    def __init__(self, shortest_ns: int) -> None:
        self._shortest_ns = shortest_ns
        self._drain_ns = 2 * shortest_ns
        self._due_ns = -MARGIN_NS

    def restart(self, arrival_ns: int) -> None:
        """Begin anew with the number that arrives now."""
        self._due_ns = arrival_ns - MARGIN_NS

    def permits(self, ahead: int, arrival_ns: int) -> bool:
        """Whether a number so far ahead of the newest could be right; nothing is taken."""
        return self._due_ns + ahead * self._shortest_ns <= arrival_ns

    def allows(self, ahead: int, arrival_ns: int) -> bool:
        """Whether a number so far ahead of the newest can be right; then it counts as taken."""
        due_ns = self._due_ns + ahead * self._shortest_ns
        if due_ns > arrival_ns:
            return False
        above_ns = arrival_ns - MARGIN_NS - due_ns
        if above_ns > 0:
            due_ns += above_ns if above_ns < self._drain_ns else self._drain_ns
        self._due_ns = due_ns
        return True
