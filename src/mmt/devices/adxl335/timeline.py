"""Samples on one unbroken time axis, from a board's wrapping counters."""

from collections import Counter
from collections.abc import Sequence
from typing import Final

from mmt.devices.adxl335.framing import Counts, Frame

_MASK: Final = 0xFFFFFFFF
_LARGEST_GAP: Final = 1 << 20
"""Samples; a counter that moves by more, or backwards, has begun anew."""
_RESTART_GAP_US: Final = 1000


class Timeline:
    """Number and time the samples of frames that follow each other.

    A frame gives the number and the time of its last sample; those before it lie evenly between
    the last sample of the frame before and this one. So of the first frame, of which nothing
    lies before, the last sample alone is used.
    """

    def __init__(self) -> None:
        self.faults: Counter[str] = Counter()
        """``lost samples``, ``repeated frames``, ``restarts`` of the board."""
        self._last: Frame | None = None
        self._time_us = 0

    def place(self, frame: Frame) -> Sequence[tuple[int, Counts]]:
        """Return the frame's samples as (time_ns, counts), oldest first.

        Times begin at the board's own first one and never go back, also where its 32-bit counter
        wraps (every 71.6 minutes) or the board starts anew.
        """
        last, self._last = self._last, frame
        if last is None:
            self._time_us = frame.time_us
            return ((frame.time_us * 1000, frame.samples[-1]),)
        step = (frame.sequence - last.sequence) & _MASK
        if step == 0:
            self._last = last
            self.faults["repeated frames"] += 1
            return ()
        if step > _LARGEST_GAP:
            self.faults["restarts"] += 1
            self._time_us += _RESTART_GAP_US
            return ((self._time_us * 1000, frame.samples[-1]),)
        elapsed_us = (frame.time_us - last.time_us) & _MASK
        self._time_us += elapsed_us
        end_ns = self._time_us * 1000
        samples = frame.samples
        if step == len(samples) == 1:  # the usual case, several times as quick
            return ((end_ns, samples[0]),)
        number = min(len(samples), step)
        if step > number:
            self.faults["lost samples"] += step - number
        return tuple(
            (end_ns - elapsed_us * 1000 * back // step, samples[-1 - back])
            for back in range(number - 1, -1, -1)
        )
