"""A sensor's clock against the host's, estimated from the arrival times of its readings.

No reading arrives before it was measured: the arrival by the host's clock minus the sensor's
stamp is never less than the true difference of the clocks, and comes close to it for the
quickest readings. The estimate is a line below all these differences. Its slope is the drift:
that of the edge of their lower convex hull at the middle of the history, as in S. B. Moon,
P. Skelly, D. Towsley: *Estimation and Removal of Clock Skew from Network Delay Measurements*,
INFOCOM 1999. Its height is set by the newest second alone. The drift changes only as far as the
history contradicts it, so that a short history does not make it wander.

This module reads no clock: the caller passes the times.
"""

from collections import deque
from itertools import islice
from statistics import median
from typing import Final

BLOCK_NS: Final = 250_000_000
"""The quickest arrival is kept of each block of this length."""

_BLOCKS: Final = 160
"""Blocks of history from which the drift is estimated."""
_RECENT_BLOCKS: Final = 4
"""Newest whole blocks that set the height of the line."""
_LEAST_BLOCKS: Final = 4
_DOUBT_NS: Final = 60_000
"""Distance from the line of a block's quickest reading, at best."""
_QUARTZ: Final = 200e-6
"""Two crystals hardly drift more against each other; ceramic resonators may."""
_LOAD_NS: Final = 5_000_000
"""Largest delay of even the quickest readings while a machine is busy."""
_JUMP_NS: Final = 5_000_000
"""An arrival this far before the line, or blocks this far behind it, mean a jump of the clock."""
_WITNESSES: Final = 4
"""Blocks in a row behind the line that mean a jump; one alone may come from a busy machine."""

_Point = tuple[int, float]
"""Host's time since the origin, and the difference of the clocks less that of the origin (ns)."""


class SensorClock:
    """Follow the clock of a sensor.

    `add` takes about half a microsecond, and some 50 us once for each block. The history is
    bounded.
    """

    def __init__(self) -> None:
        self.jumps = 0
        """How often the sensor's clock has jumped against the host's, or has seemed to since the
        machine was busy for long."""
        self._drift = 0.0
        self.reset()

    def reset(self) -> None:
        """Start again, as after a restart of the sensor; drift and number of jumps stay."""
        self._origin: tuple[int, int] | None = None
        self._blocks: deque[_Point] = deque(maxlen=_BLOCKS)
        self._quickest: _Point | None = None  # of the block that is being filled
        self._block_ends = BLOCK_NS
        self._height = 0.0
        self._late_blocks = 0

    @property
    def drift(self) -> float:
        """Seconds by which the host's clock gains on the sensor's in a second."""
        return self._drift

    @property
    def known(self) -> bool:
        """Whether anything has arrived since the last reset."""
        return self._origin is not None

    def add(self, arrival_ns: int, sensor_ns: int) -> None:
        """Add the newest of the readings that have arrived together.

        Parameters
        ----------
        arrival_ns
            Time at which it was found, by the host's clock.
        sensor_ns
            Its stamp by the sensor's clock.
        """
        if self._origin is None:
            self._origin = (arrival_ns, arrival_ns - sensor_ns)
        origin_ns, zero_ns = self._origin
        time = arrival_ns - origin_ns
        difference = float(arrival_ns - sensor_ns - zero_ns)
        height = difference - self._drift * time
        if height < self._height:
            if height < self._height - _JUMP_NS:
                self._jump(time, height)
                return
            self._height = height
        quickest = self._quickest
        if quickest is None or height < quickest[1] - self._drift * quickest[0]:
            self._quickest = (time, difference)
        if time >= self._block_ends:
            self._end_block(time)

    def sensor_time(self, host_ns: int) -> int:
        """Return the sensor's time (ns) at a time of the host.

        Raises
        ------
        ValueError
            No reading has arrived yet.
        """
        if self._origin is None:
            raise ValueError("nothing has arrived from the sensor yet")
        origin_ns, zero_ns = self._origin
        return host_ns - zero_ns - round(self._height + self._drift * (host_ns - origin_ns))

    def _jump(self, time: int, height: float) -> None:
        """Start the line again at this height."""
        self.jumps += 1
        self._height = height
        self._late_blocks = 0
        self._blocks.clear()
        self._quickest = None
        self._block_ends = time + BLOCK_NS

    def _end_block(self, time: int) -> None:
        point = self._quickest
        assert point is not None  # noqa: S101 - the caller has just set it
        height = point[1] - self._drift * point[0]
        late = height > self._height + _JUMP_NS
        self._late_blocks = self._late_blocks + 1 if late else 0
        if self._late_blocks >= _WITNESSES:
            self._jump(time, height)
            return
        self._quickest = None
        self._block_ends = time + BLOCK_NS
        if late:  # the line stays as it was
            return
        self._blocks.append(point)
        if len(self._blocks) >= _LEAST_BLOCKS:
            self._drift = _drift(list(self._blocks), self._drift)
        self._height = min(
            difference - self._drift * time
            for time, difference in islice(reversed(self._blocks), _RECENT_BLOCKS)
        )


def _drift(points: list[_Point], believed: float) -> float:
    """Return the drift nearest to the believed one that the points allow.

    A drift beyond that of quartz is taken only if it amounts to more than load explains.
    """
    slope, doubt = _slope_below(points)
    drift = min(max(believed, slope - doubt), slope + doubt)
    span = points[-1][0] - points[0][0]
    if abs(slope) * span < _QUARTZ * span + _LOAD_NS:
        drift = min(max(drift, -_QUARTZ), _QUARTZ)
    return drift


def _slope_below(points: list[_Point]) -> tuple[float, float]:
    """Return the slope of the line below the points that is closest in sum, and its uncertainty.

    It is the edge of the lower convex hull at the mean time. The uncertainty grows with the usual
    distance of a point from the line: on a busy machine even the quickest readings are late.
    """
    hull: list[_Point] = []
    for point in points:
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    middle = sum(time for time, _ in points) / len(points)
    after = next(index for index, (time, _) in enumerate(hull) if index and time >= middle)
    first, second = hull[after - 1], hull[after]
    slope = (second[1] - first[1]) / (second[0] - first[0])
    above = median(point[1] - first[1] - slope * (point[0] - first[0]) for point in points)
    return slope, (_DOUBT_NS + 2.0 * above) / (points[-1][0] - points[0][0])


def _turns_down(first: _Point, middle: _Point, last: _Point) -> bool:
    """Return whether the middle point lies on or above the line through the others."""
    return (middle[1] - first[1]) * (last[0] - first[0]) >= (last[1] - first[1]) * (
        middle[0] - first[0]
    )
