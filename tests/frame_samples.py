"""Frames that tests of both services, and of their parts, stream."""

import numpy as np

from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL, channels_of, frame_dtype

PERIOD_NS = 1_000_000


def made_frames(first, count, channels=CHANNELS, samples_per_frame=1):
    """Frames whose numbers tell which they are."""
    frames = np.zeros(count, frame_dtype(channels, samples_per_frame))
    frames["sequence"] = np.arange(first, first + count)
    frames["time_ns"] = frames["sequence"].astype(np.int64) * PERIOD_NS
    for channel in channels_of(frames.dtype):
        values = frames[FIELD_OF_CHANNEL[channel]]
        numbers = np.arange(first, first + count).reshape(-1, *(1 for _ in values.shape[1:]))
        frames[FIELD_OF_CHANNEL[channel]] = numbers % 50
    return frames
