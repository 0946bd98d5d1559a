"""The longest time without a command before the leader counts as silent."""

from typing import Final

from mmt.scene import Link

_GAIN: Final = 1 / 8
_DEVIATION_GAIN: Final = 1 / 4
_DEVIATIONS: Final = 4.0
_LEAST_MARGIN_NS: Final = 20_000_000


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
