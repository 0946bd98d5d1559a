"""Frames and aligned samples of steady strokes, for tests of what follows in the stream."""

import numpy as np

from mmt.core.frames import empty_frames
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.filtering import StreamFilter


def stroke_frames(vibration, gravity=9.81):
    """Return frames of a stroke at 100 mm/s and 1 N with a vibration (n,) along z."""
    acceleration = np.zeros((len(vibration), 1, 3))
    acceleration[:, 0, 2] = gravity + vibration
    return stroked(acceleration)


def stroked(acceleration):
    """Return frames of a stroke at 100 mm/s and 1 N, with acceleration (n, k, 3)."""
    count, per_frame, _ = acceleration.shape
    frames = empty_frames(count, samples_per_frame=per_frame)
    frames["sequence"] = np.arange(count)
    frames["time_ns"] = 1_000_000 * np.arange(count)
    frames["position_mm"][:, 0] = 0.1 * np.arange(count)
    frames["force_n"][:, 2] = 1.0
    frames["acceleration_m_s2"] = acceleration.reshape(frames["acceleration_m_s2"].shape)
    return frames


def aligned(vibration, first=0, **channels):
    """Return samples with a vibration (n, k, axes) and other channels: all 0 but those given."""
    count = len(vibration)
    index = first + np.arange(count)
    usual = {
        "position_mm": np.zeros((count, 3)),
        "velocity_mm_s": np.zeros((count, 2)),
        "speed_mm_s": np.zeros(count),
        "normal_force_n": np.zeros(count),
        "valid": np.ones(count, np.bool_),
        "measured": np.ones(count, np.bool_),
    }
    for name, values in channels.items():
        usual[name][:] = values
    return AlignedBlock(
        index=index, time_ns=1_000_000 * index + 77, vibration_m_s2=vibration, **usual
    )


def judged(frames):
    """Return the filtered samples of a stream, and its faults."""
    stream = StreamFilter()
    return stream.process(frames), stream.faults
