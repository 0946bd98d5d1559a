"""What the modelling's high-pass takes from lines that are too slow for it, given back.

Ridges that a stroke follows, or crosses slowly, have lines below some 15 Hz, of which the 10 Hz
high-pass leaves too little. It stands there to keep the hand's own motion out. What the hand does
at those frequencies is told in the air, where nothing is felt and the hand moves no less than in a
stroke. So a segment is modelled from vibration with a lower corner where this brings more power
than it brings in nine of ten windows in the air; the others, and all segments as long as the hand
is not known, stay as they are.

The lower corner is half an octave below. A second-order high-pass lets motion far below its
corner through with an amplitude of 1 / corner^2: twice as much, while a line at 8 Hz keeps 0.62
of its power in place of 0.29. Two high-passes of one order differ by a quotient of
denominators, a stable filter of gain 1 for high frequencies and 2 for a constant, through which
the vibration is led on. It starts, like the high-pass itself, in the steady state of the first
sample after a gap, so that the two together are the high-pass of the lower corner to rounding.
"""

from collections import deque
from dataclasses import replace
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.segmentation.segments import Segment
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.biquad import Biquad, butterworth_high_pass
from mmt.texture.signals.dft321 import dft321
from mmt.texture.signals.filtering import VIBRATION_CUTOFF_HZ, SectionFilter
from mmt.texture.signals.noise_floor import WINDOWS_KEPT, still_powers

LOW_CUTOFF_HZ: Final = VIBRATION_CUTOFF_HZ / 2.0**0.5

LEAST_AIR_WINDOWS: Final = 20
"""A second in the air; with less, a start with a quiet hand would stand for all that follows."""

_PERCENTILE: Final = 90.0
_KEPT_SAMPLES: Final = 10_000
"""Before the newest block; a segment that is still found reaches back a second or two."""


class LowBand:
    """The vibration of a stream with a lower corner, and how much of that is the hand's.

    Cost: 0.1 us a sample and axis.

    Parameters
    ----------
    rate_hz
        Of the stream.
    """

    def __init__(self, rate_hz: float) -> None:
        self._filter = SectionFilter(lowering(rate_hz))
        self._index = np.zeros(0, np.int64)
        self._vibration_m_s2: FloatArray | None = None
        self._hand: deque[float] = deque(maxlen=WINDOWS_KEPT)

    def update(self, block: AlignedBlock) -> None:
        """Take the next block of the stream."""
        if not len(block):
            return
        before = self._index[-1] if len(self._index) else block.index[0] - 2
        restart = np.diff(block.index, prepend=before) != 1
        low = self._filter.process(block.vibration_m_s2, restart)
        gain = np.square(low).sum(axis=1) - np.square(block.vibration_m_s2).sum(axis=1)
        self._hand.extend(still_powers(block, gain, at_rest=False))
        kept = slice(-_KEPT_SAMPLES, None)
        self._index = np.concatenate([self._index[kept], block.index])
        if self._vibration_m_s2 is not None:
            low = np.concatenate([self._vibration_m_s2[kept], low])
        self._vibration_m_s2 = low

    @property
    def hand_power(self) -> float:
        """Power in (m/s2)^2 that the lower corner brings in the air.

        Its 90th percentile over windows; infinite as long as nothing is known.
        """
        if len(self._hand) < LEAST_AIR_WINDOWS:
            return float("inf")
        return float(np.percentile(self._hand, _PERCENTILE))

    def restored(self, segment: Segment) -> Segment:
        """Return a segment with what the high-pass took, where that is not the hand's."""
        if self._vibration_m_s2 is None:
            return segment
        start = int(np.searchsorted(self._index, segment.start))
        stop = start + segment.stop - segment.start
        if not np.array_equal(self._index[start:stop], np.arange(segment.start, segment.stop)):
            return segment
        low = self._vibration_m_s2[start:stop]
        power = float(np.square(low).sum(axis=1).mean())
        if not power > np.mean(np.square(segment.vibration_m_s2)) + self.hand_power:
            return segment
        return replace(
            segment, vibration_m_s2=dft321(low) if low.shape[1] == 3 else low[:, 0].copy()
        )


def lowering(rate_hz: float) -> Biquad:
    """Return what turns the published high-pass into the one of the lower corner."""
    usual = butterworth_high_pass(VIBRATION_CUTOFF_HZ, rate_hz)
    lower = butterworth_high_pass(LOW_CUTOFF_HZ, rate_hz)
    gain = lower.b0 / usual.b0
    return Biquad(gain, gain * usual.a1, gain * usual.a2, lower.a1, lower.a2, rate_hz)
