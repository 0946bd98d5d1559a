"""Frames that tests of both services, and of their parts, stream."""

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.frames import FIELD_OF_CHANNEL, channels_of, frame_dtype

PERIOD_NS = 1_000_000


def made_frames(first: int, count: int, channels: tuple[str, ...] | None = None) -> RecordArray:
    """Frames whose numbers tell which they are."""
    frames = np.zeros(count, frame_dtype(channels) if channels else frame_dtype())
    frames["sequence"] = np.arange(first, first + count)
    frames["time_ns"] = frames["sequence"].astype(np.int64) * PERIOD_NS
    for channel in channels_of(frames.dtype):
        frames[FIELD_OF_CHANNEL[channel]] = np.arange(first, first + count)[:, None] % 50
    return frames
