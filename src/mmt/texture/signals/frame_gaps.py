"""The frames of a stream that can be used, with short gaps in their sequence filled."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray, RecordArray
from mmt.texture.signals.aligned import Columns

LARGEST_MEASUREMENT: Final = 1e6
"""Largest position (mm), force (N) or acceleration (m/s2); a number beyond it is broken."""


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
