"""Frames and sessions that the tests of this folder share."""

import numpy as np

from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL, frame_dtype

START_NS = 12_345_678_901_234


def made_frames(count, channels=CHANNELS, *, seed=1, steps=None, samples_per_frame=1):
    """Frames with random values and jittered times; `steps` are the sequence's jumps."""
    rng = np.random.default_rng(seed)
    frames = np.zeros(count, dtype=frame_dtype(channels, samples_per_frame))
    jumps = np.ones(max(0, count - 1), dtype=np.int64) if steps is None else np.asarray(steps)
    sequence = np.concatenate([[0], np.cumsum(jumps)])[:count]
    frames["sequence"] = sequence
    frames["time_ns"] = START_NS + sequence * 1_000_000 + rng.integers(0, 20_000, count)
    for channel in channels:
        field = frames[FIELD_OF_CHANNEL[channel]]
        field[...] = rng.normal(size=field.shape) * 10
        if channel == "orientation":
            field /= np.linalg.norm(field, axis=1, keepdims=True)
    return frames
