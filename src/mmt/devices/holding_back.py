"""How long a frame must be held back, from how old the newest readings are while nobody waits.

A frame is of an instant between two readings that have arrived. The age of the newest one goes up
and down with the sensor's period, the bundles in which its readings are handed on, and the time
that they are under way; its upper end is the least by which frames can be held back.
"""

from collections.abc import Iterable
from typing import Final

from mmt.devices.merging import Lane

MARGIN_NS: Final = 100_000
"""Beyond the age: a tick reads some tens of microseconds after it began, and a reading that is
later still is looked for again."""

_SHARE: Final = 0.98
"""Of the looks; what is older comes from a host that was held up."""
_FEW: Final = 100
"""Fewer looks at a sensor than this do not tell."""


class ReadingAges:
    """Collect the ages of the newest readings.

    Parameters
    ----------
    lanes
        Of sensors with clocks of their own.
    """

    def __init__(self, lanes: Iterable[Lane]) -> None:
        self._looks: list[tuple[Lane, list[tuple[int, int]]]] = [(lane, []) for lane in lanes]

    def look(self, now_ns: int) -> None:
        """Note how old the newest readings are, at a time of the host."""
        for lane, looks in self._looks:
            if lane.newest is not None:
                looks.append((now_ns, lane.newest.time_ns))

    def hold_back_ns(self) -> int | None:
        """Return how long to hold frames back, latencies of the sensors included.

        None where there were too few looks to tell.
        """
        longest_ns = 0
        for lane, looks in self._looks:
            if len(looks) < _FEW:
                return None
            ages = sorted(
                lane.clock.sensor_time(now_ns) + lane.latency_ns - stamp_ns
                for now_ns, stamp_ns in looks
            )
            longest_ns = max(longest_ns, ages[int(_SHARE * len(ages))])
        return longest_ns + MARGIN_NS
