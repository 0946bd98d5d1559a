"""How long a frame must be held back, from how old the newest readings are while nobody waits.

A frame is of an instant between two readings that have arrived. The age of the newest one goes up
and down with the sensor's period, the bundles in which its readings are handed on, and the time
that they are under way; its upper end is the least by which frames can be held back.
"""

from collections.abc import Iterable
from statistics import median
from typing import Final

from mmt.devices.merging import Lane

MARGIN_NS: Final = 100_000
"""Beyond the age: a tick reads some tens of microseconds after it began, and a reading that is
later still is looked for again."""

_BLOCK_NS: Final = 20_000_000
_SHARE: Final = 0.98
"""Of a block's looks; the oldest is taken of these, then the median over the blocks: what is older
comes from a host that was held up."""
_FEW: Final = 20
"""A block with fewer looks than this does not tell."""


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
        oldest_ns = [_oldest_ns(lane, looks) for lane, looks in self._looks]
        known_ns = [age_ns for age_ns in oldest_ns if age_ns is not None]
        return max(known_ns) + MARGIN_NS if oldest_ns and len(known_ns) == len(oldest_ns) else None


def _oldest_ns(lane: Lane, looks: list[tuple[int, int]]) -> int | None:
    """Return the upper end of the ages that looks (host's time, stamp) have found."""
    ages: dict[int, list[int]] = {}
    for now_ns, stamp_ns in looks:
        age_ns = lane.clock.sensor_time(now_ns) + lane.latency_ns - stamp_ns
        ages.setdefault(now_ns // _BLOCK_NS, []).append(age_ns)
    oldest = [
        sorted(block)[int(_SHARE * len(block))] for block in ages.values() if len(block) >= _FEW
    ]
    return round(median(oldest)) if oldest else None
