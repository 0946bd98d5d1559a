"""Restoration of the low-frequency vibration that the modelling's high-pass removes.

Ridges that a stroke follows, or crosses slowly, have lines below some 15 Hz, which the 10 Hz
high-pass attenuates. The high-pass is there to remove the hand's own motion. How much of that
motion lies at those frequencies is measured in the air, where nothing is touched and the hand moves
no less than in a stroke. A segment is modelled from vibration with a lower corner where this adds
more power than it adds in nine of ten windows in the air; all others, and all segments as long as
too few windows were measured, are unchanged.

The lower corner is half an octave below. A second-order high-pass passes motion far below its
corner with an amplitude of 1 / corner^2: twice as much, while a line at 8 Hz keeps 0.62 of its
power instead of 0.29. Two high-passes of one order differ by a quotient of denominators, a stable
filter of gain 1 at high frequencies and 2 at zero, which is applied to the vibration. It starts,
like the high-pass itself, in the steady state of the first sample after a gap, so that the two
together are the high-pass of the lower corner to rounding.
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
"""Least windows in the air, a second: fewer may miss how much the hand moves later."""

_PERCENTILE: Final = 90.0
_KEPT_SAMPLES: Final = 10_000
"""Samples kept before the newest block; segments reach back a second or two."""


class LowBand:
    """Vibration of a stream with a lower corner frequency, and the power of the hand in it.

    Cost: 0.1 us a sample and axis.

    Parameters
    ----------
    rate_hz
        Sampling rate of the stream.
    """

    def __init__(self, rate_hz: float) -> None:
        self._filter = SectionFilter(lowering(rate_hz))
        self._index = np.zeros(0, np.int64)
        self._vibration_m_s2: FloatArray | None = None
        self._hand: deque[float] = deque(maxlen=WINDOWS_KEPT)

    def update(self, block: AlignedBlock) -> None:
        """Add the next block of the stream."""
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
        """Power in (m/s2)^2 that the lower corner adds in the air: its 90th percentile.

        Infinite with fewer than `LEAST_AIR_WINDOWS` windows.
        """
        if len(self._hand) < LEAST_AIR_WINDOWS:
            return float("inf")
        return float(np.percentile(self._hand, _PERCENTILE))

    def restored(self, segment: Segment) -> Segment:
        """Return the segment with its low band restored where that exceeds the hand's power."""
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
    """Return the section that turns the published high-pass into that of the lower corner."""
    usual = butterworth_high_pass(VIBRATION_CUTOFF_HZ, rate_hz)
    lower = butterworth_high_pass(LOW_CUTOFF_HZ, rate_hz)
    gain = lower.b0 / usual.b0
    return Biquad(gain, gain * usual.a1, gain * usual.a2, lower.a1, lower.a2, rate_hz)
