"""A lane that keeps vibration: its value between two readings comes from nine of them."""

from functools import lru_cache
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.devices.lanes import WAITING, Lane, Waiting, on_line
from mmt.devices.protocols import Vector

BEFORE: Final = 8
"""Readings before the instant that have a part in its value; one after it has."""

PHASES: Final = 256
"""Instants between two readings that have weights of their own; the nearest is taken."""

BAND_HZ: Final = 500.0
"""Half the session's rate: what lies above folds, whatever the weights."""

_SHARE: Final = 0.42
"""Share of the sensor's rate: the band of a slow one. Near half its rate nothing can be had from
readings of the past without amplifying what is between."""
_NOISE: Final = 1e-3
"""Power beside the band, over that within it."""

Weights = tuple[tuple[float, ...], ...]
"""Rows by the instant, 0 at the reading before it to `PHASES` at the one after it; columns by the
reading, the oldest first."""


def band_of(rate_hz: float) -> float:
    """Return the band over a sensor's rate for which its weights are made."""
    return min(BAND_HZ / rate_hz, _SHARE)


@lru_cache(maxsize=8)
def weights(band: float) -> Weights:
    """Return the weights for a band from 0 up; some 0.3 ms.

    Parameters
    ----------
    band
        Highest frequency over the sensor's rate, above 0 and below 0.5.

    Raises
    ------
    ValueError
        There is no such band.
    """
    if not 0.0 < band < 0.5:
        raise ValueError(f"band is {band}: it must lie within 0 to half the rate")
    places = np.arange(1.0 - BEFORE, 2.0)
    instants = np.arange(PHASES + 1) / PHASES
    count = len(places)
    exact: FloatArray = np.vstack((np.ones(count), places))
    system = np.zeros((count + 2, count + 2))
    system[:count, :count] = np.sinc(2.0 * band * (places[:, None] - places))
    system[:count, :count] += _NOISE * np.eye(count)
    system[:count, count:], system[count:, :count] = exact.T, exact
    wanted = np.vstack(
        (
            np.sinc(2.0 * band * (places[:, None] - instants)),
            np.ones(len(instants)),
            instants,
        )
    )
    solved = np.linalg.solve(system, wanted)[:count]
    return tuple(tuple(row) for row in solved.T.tolist())


_UNEVEN: Final = 0.5
"""Share of a period by which nine readings may be off an even spacing; a lost one makes 1."""
_OTHER_RATE: Final = 0.05
"""A sensor's period that has changed by so much gets weights of its own."""


class VibrationLane(Lane):
    """Like a `Lane`, but a frame's value comes from eight readings before and one after it.

    See `mmt.devices.vibration_lane`. Where a reading is missing among them, and at the
    beginning, the value lies on the straight line between its two neighbours. A value takes
    twice as long as on that line.
    """

    def __init__(self, latency_ns: int = 0) -> None:
        super().__init__(latency_ns)
        self._weights: Weights = ()
        self._made_for_ns = 0.0

    def _interpolate(self, time_ns: int, longest_ns: float) -> "Vector | Waiting | None":
        kept = self._kept
        if not kept or kept[-1].time_ns < time_ns:
            return WAITING
        while len(kept) > BEFORE and kept[BEFORE].time_ns <= time_ns:
            kept.popleft()
        if len(kept) <= BEFORE or kept[BEFORE - 1].time_ns > time_ns:
            return self._near_the_beginning(time_ns, longest_ns)
        start, end = kept[BEFORE - 1], kept[BEFORE]
        span = end.time_ns - start.time_ns
        uneven_ns = abs(end.time_ns - kept[0].time_ns - BEFORE * span)
        if span > longest_ns or uneven_ns > _UNEVEN * span:
            return on_line(start, end, time_ns, longest_ns)
        if abs(self.period_ns - self._made_for_ns) > _OTHER_RATE * self.period_ns:
            self._made_for_ns = self.period_ns
            self._weights = weights(band_of(1e9 / self.period_ns))
        x = y = z = 0.0
        row = self._weights[round((time_ns - start.time_ns) / span * PHASES)]
        for weight, (_, (u, v, w)) in zip(row, kept, strict=False):  # what comes later has no part
            x += weight * u
            y += weight * v
            z += weight * w
        return x, y, z

    def _near_the_beginning(self, time_ns: int, longest_ns: float) -> Vector | None:
        """Return the value where fewer readings lie before the instant."""
        older = newer = self._kept[0]
        for newer in self._kept:
            if newer.time_ns > time_ns:
                break
            older = newer
        return on_line(older, newer, time_ns, longest_ns)
