"""A lane that keeps vibration: its value between two readings comes from nine of them."""

from typing import Final

from mmt.devices.merging import WAITING, Lane, Waiting, on_line
from mmt.devices.protocols import Vector
from mmt.devices.reconstruction import BEFORE, PHASES, Weights, band_of, weights

_UNEVEN: Final = 0.5
"""Of a period, by which nine readings may be off an even spacing; a lost one makes a whole."""
_OTHER_RATE: Final = 0.05
"""A sensor's period that has changed by so much gets weights of its own."""


class VibrationLane(Lane):
    """Like a `Lane`, but a frame's value comes from eight readings before and one after it.

    See `mmt.devices.reconstruction`. Where a reading is missing among them, and at the
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
        if abs(self._spacing_ns - self._made_for_ns) > _OTHER_RATE * self._spacing_ns:
            self._made_for_ns = self._spacing_ns
            self._weights = weights(band_of(1e9 / self._spacing_ns))
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
