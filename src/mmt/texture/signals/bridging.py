"""Filling of short stretches without a measurement from the vibration around them.

An autoregressive model is fitted to the newest samples before the gap by Burg's method. The missing
samples are those that minimise its prediction errors, also over the samples after the gap (Janssen,
Veldhuis and Vries, "Adaptive interpolation of discrete-time signals that can be modeled as
autoregressive processes", IEEE Trans. ASSP 34 (1986), 317-330). They are expected values, without
an unpredictable part. So filled samples have less power than measured ones, and do not count as
measured.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.burg import burg_into
from mmt.texture.autoregression.lsf import reflection_to_ar_into
from mmt.texture.linear_algebra import backward, factorise, forward

HISTORY: Final = 256
"""Largest number of samples before a gap to which the model is fitted, with one sample in a frame;
up to four times as many with several."""

ORDER: Final = 16
"""Order of the model with one sample in a frame, and twice that with several. At 10 kHz, errors are
then as small as at 1 kHz, and no smaller with order 64, from 256 or from 2560 samples."""

_LEAST: Final = 4  # samples for each order of a fit; with fewer, a straight line


@kernel("i8(i8)")
def history_of(per_frame: int) -> int:
    """Return how many samples before a gap the model is fitted to at most."""
    return HISTORY * min(per_frame, 4)


@kernel("void(f8[:], b1[::1], i8, i8, i8, i8, i8)", inner=True)
def _fill_by_model(
    values: FloatArray,
    unknown: BoolArray,
    start: int,
    stop: int,
    count: int,
    newest: int,
    order: int,
) -> None:
    """Fill a gap of one channel by the model of the samples before it."""
    past = values[start - count : start].copy()
    mean = past.mean()
    past -= mean
    reflection, variances = np.empty(order), np.empty(order + 1)
    if not burg_into(past, reflection, variances, np.empty(2 * count)):
        return
    taps = np.ones(order + 1)
    reflection_to_ar_into(reflection, taps[1:])
    # Gaps that follow this one are unknowns too; their values are not used.
    span = newest + 1 - start
    place, unknowns = np.full(span, -1), 0
    for row in range(span):
        if unknown[start + row]:
            place[row] = unknowns
            unknowns += 1
    normal, right = np.zeros((unknowns, unknowns)), np.zeros((1, unknowns))
    row_of = np.empty(unknowns)
    for row in range(span):
        row_of[:] = 0.0
        known = 0.0
        for lag in range(order + 1):
            at = row - lag
            if at >= 0 and place[at] >= 0:
                row_of[place[at]] += taps[lag]
            else:
                known += taps[lag] * (values[start + at] - mean)
        for i in range(unknowns):
            if row_of[i] != 0.0:
                right[0, i] -= row_of[i] * known
                for j in range(unknowns):
                    normal[i, j] += row_of[i] * row_of[j]
    if not factorise(normal):
        return
    forward(normal, right, False)
    backward(normal, right)
    for row in range(start, stop):
        values[row] = mean + right[0, place[row - start]]


@kernel("void(f8[:, ::1], b1[::1], i8, i8, i8, i8, i8)")
def fill(
    samples: FloatArray,
    unknown: BoolArray,
    start: int,
    stop: int,
    history: int,
    newest: int,
    per_frame: int,
) -> None:
    """Fill a gap in all channels, in place.

    Parameters
    ----------
    samples : (n, channels)
    unknown : (n,)
        Samples that are not measured.
    start, stop
        The gap; `start` > 0, and `stop` is measured.
    history
        Number of successive samples before the gap that are measured or filled; at least 1.
    newest
        The last sample that is used.
    per_frame
        Samples in a frame.
    """
    count, order = min(history, history_of(per_frame)), ORDER * min(per_frame, 2)
    for channel in range(samples.shape[1]):
        values = samples[:, channel]
        first, last = values[start - 1], values[stop]
        for row in range(start, stop):
            values[row] = first + (last - first) * (row - start + 1) / (stop - start + 1)
        if count >= _LEAST * order:
            _fill_by_model(values, unknown, start, stop, count, newest, order)
