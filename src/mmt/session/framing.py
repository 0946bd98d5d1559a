"""Turn somebody else's recording into frames, resampled where it needs to be."""

from collections.abc import Mapping

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL, Channel, frame_dtype
from mmt.session.recorded import FRAME_PERIOD_NS
from mmt.session.samples import Samples

_GRID_TOLERANCE = 0.2
"""Periods by which a time may lie off the 1 kHz grid and still be on it."""
_RATE_TOLERANCE = 0.01


def frames_of(samples: Samples, longest_gap_s: float | None = None) -> RecordArray:
    """Return samples as frames (n,) at 1 kHz, resampled only where they need it.

    Rows that already lie on a 1 kHz grid, within a fifth of a period, become frames as
    they are; so do those of an exported session, which have their frame numbers.
    Everything else goes through `mmt.session.resampling`, which imports scipy.

    Raises
    ------
    InputError
        The samples are not valid, or too few or too far apart to give a frame.
    """
    samples.check()
    numbers = None if samples.acceleration_time_s is not None else _frame_numbers(samples)
    if numbers is not None:
        time_ns = np.rint((samples.time_s - samples.time_s[0]) * 1e9).astype(np.int64)
        return _frames(samples, numbers, time_ns, samples.values)
    from mmt.session.resampling import resample

    numbers, values = resample(samples, longest_gap_s)
    return _frames(samples, numbers, numbers * FRAME_PERIOD_NS, values)


def _frame_numbers(samples: Samples) -> IntArray | None:
    """Return the frame number of each row, None where the rows are no frames."""
    periods = (samples.time_s - samples.time_s[0]) * 1000.0
    if samples.sequence is not None and len(samples.sequence) == len(periods):
        numbers = np.rint(samples.sequence)
        span = numbers[-1] - numbers[0]
        in_range = numbers[0] >= 0 and numbers[-1] < 2**32
        at_the_rate = abs(span - periods[-1]) <= max(1.0, _RATE_TOLERANCE * span)
        if in_range and at_the_rate and bool(np.all(np.diff(numbers) > 0)):
            return np.asarray(numbers, dtype=np.int64)
    numbers = np.rint(periods)
    steps = np.diff(numbers)
    on_the_grid = np.abs(periods - numbers).max() <= _GRID_TOLERANCE
    if on_the_grid and steps.min() > 0 and np.median(steps) == 1:
        return np.asarray(numbers, dtype=np.int64)
    return None


def _frames(
    samples: Samples,
    numbers: IntArray,
    time_ns: IntArray,
    values: Mapping[Channel, FloatArray],
) -> RecordArray:
    if len(numbers) == 0:
        raise InputError(
            f"{samples.origin}: no frame can be made: the samples of its channels share no "
            "stretch of time in which they are close enough together; are the times in "
            "seconds? Otherwise allow a longer gap"
        )
    channels = [channel for channel in CHANNELS if channel in values]
    frames = np.zeros(len(numbers), dtype=frame_dtype(channels))
    frames["sequence"] = numbers
    frames["time_ns"] = time_ns
    for channel in channels:
        frames[FIELD_OF_CHANNEL[channel]] = values[channel]
    return frames
