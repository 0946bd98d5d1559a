"""Filling of short gaps: motion and force from frame to frame, vibration from that around them.

Position and force are interpolated linearly where few frames are missing. For the acceleration an
autoregressive model is fitted to the newest samples before the gap by Burg's method. The missing
samples are those that minimise its prediction errors, also over the samples after the gap (Janssen,
Veldhuis and Vries, "Adaptive interpolation of discrete-time signals that can be modeled as
autoregressive processes", IEEE Trans. ASSP 34 (1986), 317-330). They are expected values, without
an unpredictable part. So filled samples have less power than measured ones, and do not count as
measured.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray, RecordArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.burg import burg_into
from mmt.texture.autoregression.lsf import reflection_to_ar_into
from mmt.texture.linear_algebra import backward, factorise, forward
from mmt.texture.signals.aligned import Columns

LARGEST_MEASUREMENT: Final = 1e6
"""Largest position (mm), force (N) or acceleration (m/s2); a number beyond it is broken."""

HISTORY: Final = 256
"""Largest number of samples before a gap to which the model is fitted, with one sample in a frame;
up to four times as many with several."""

ORDER: Final = 16
"""Order of the model with one sample in a frame, and twice that with several. At 10 kHz, errors are
then as small as at 1 kHz, and no smaller with order 64, from 256 or from 2560 samples."""

_LEAST: Final = 4  # samples for each order of a fit; with fewer, a straight line


@dataclass(frozen=True, eq=False)
class Elements(Columns):
    """Successive frames: those that came, and filled ones, which are ``missing`` (n,).

    ``motion`` (n, 4) is position in mm and normal force in N, ``acceleration`` (n, k, axes) in
    m/s2, k samples a frame.
    """

    index: IntArray
    time_ns: IntArray
    motion: FloatArray
    acceleration: FloatArray
    missing: BoolArray


class FrameGaps:
    """Fill short gaps in a stream of frames; its partition does not change the result.

    Parameters
    ----------
    normal
        Number of the surface's normal axis.
    axes
        Numbers of the axes of acceleration that are used.
    longest_bridged
        Largest number of missing frames in a row that are filled.
    per_frame
        Samples of acceleration in a frame.
    """

    def __init__(self, normal: int, axes: list[int], longest_bridged: int, per_frame: int) -> None:
        self._normal, self._axes, self._longest_bridged = normal, axes, longest_bridged
        none = np.zeros(0, np.int64)
        acceleration = np.zeros((0, per_frame, len(axes)))
        self._newest = Elements(none, none, np.zeros((0, 4)), acceleration, none > 0)
        self._missed = 0
        self.not_finite = 0
        """Frames with a number that is not finite, or beyond `LARGEST_MEASUREMENT`."""

    @property
    def missing(self) -> int:
        """Frames that did not come."""
        return max(0, self._missed - self.not_finite)

    def fill(self, frames: RecordArray) -> tuple[Elements, BoolArray]:
        """Return the next frames with short gaps filled, and which of them follow a longer gap.

        Acceleration is not filled here.
        """
        begun = min(len(self._newest.index), 1)
        joined = Elements.concatenate([self._newest, self._usable(frames)])
        gap = np.diff(joined.index, prepend=joined.index[:1] - 1) - 1
        self._missed += int(gap.sum())
        self._newest = joined[-1:]
        restart = gap > self._longest_bridged
        restart[: 1 - begun] = True
        times = np.where(restart, 1, gap + 1)
        row = np.repeat(np.arange(len(gap)), times)
        left = np.cumsum(times)[row] - 1 - np.arange(len(row))
        back = left / times[row]
        motion = joined.motion[row]
        motion += (joined.motion[row - 1] - motion) * back[:, None]
        time_ns = joined.time_ns[row]
        time_ns += np.rint((joined.time_ns[row - 1] - time_ns) * back).astype(np.int64)
        filled = Elements(
            joined.index[row] - left, time_ns, motion, joined.acceleration[row], left > 0
        )
        return filled[begun:], restart[row][begun:]

    def _usable(self, frames: RecordArray) -> Elements:
        """Return the frames that are plausible and newer than all before."""
        index = frames["sequence"].astype(np.int64)
        motion = np.empty((len(frames), 4))
        motion[:, :3] = frames["position_mm"]
        motion[:, 3] = frames["force_n"][:, self._normal]
        raw = frames["acceleration_m_s2"].reshape(
            len(frames), self._newest.acceleration.shape[1], 3
        )
        acceleration = raw[:, :, self._axes].astype(np.float64)
        good = (np.abs(motion) <= LARGEST_MEASUREMENT).all(axis=1)
        good &= (np.abs(acceleration) <= LARGEST_MEASUREMENT).all(axis=(1, 2))
        last = self._newest.index[-1] if len(self._newest.index) else -1
        newer = (
            index > np.maximum.accumulate(np.concatenate([[last], np.where(good, index, -1)]))[:-1]
        )
        self.not_finite += int(np.count_nonzero(newer & ~good))
        good &= newer
        return Elements(
            index[good],
            frames["time_ns"][good].astype(np.int64),
            motion[good],
            acceleration[good],
            np.zeros(np.count_nonzero(good), np.bool_),
        )


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
