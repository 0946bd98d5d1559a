"""When each sample of a frame's acceleration was taken."""

import numpy as np

from mmt.core.arrays import IntArray
from mmt.session.data import FRAME_PERIOD_NS


def sample_stamps_ns(time_ns: IntArray, samples_per_frame: int) -> IntArray:
    """Return the times (n, k) of k samples a frame, of which the last is at the frame's (n,).

    They are evenly spaced over a period, or since the frame before if that is closer.
    """
    before = np.diff(time_ns, prepend=time_ns[:1] - FRAME_PERIOD_NS).clip(0, FRAME_PERIOD_NS)
    ages = np.arange(samples_per_frame)[::-1]
    stamps: IntArray = time_ns[:, None] - before[:, None] * ages // samples_per_frame
    return stamps
