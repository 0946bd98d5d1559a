"""Resample a recording of any rate, or of uneven times, to the 1 kHz grid.

Offline only; scipy is imported where a recording needs to be resampled. Between samples at regular
times a cubic spline interpolates; between uneven ones, where a spline would overshoot without
bound, a monotone cubic (PCHIP), which stays between each two samples. A recording faster than
1 kHz is first brought to a whole multiple m of 1 kHz, then filtered and decimated by m with a
linear-phase filter of no delay: flat within 0.01 dB to 415 Hz, 80 dB down above 495 Hz, so that
nothing folds back. Within 32 ms of the ends of a stretch the filter sees the straight line between
the ends continued. Cost is linear in the number of samples.
"""

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL, SEQUENCES, Channel, frame_dtype
from mmt.session.data import FRAME_PERIOD_NS
from mmt.session.importing.samples import Samples
from mmt.session.importing.stamps import StampChoice, Stamps, assess_stamps

RATE_HZ: Final = 1000.0
DEFAULT_GAP_INTERVALS: Final = 5.0
DEFAULT_GAP_S: Final = (0.005, 0.1)
"""Bounds of the default for the longest gap that is interpolated."""

_CUTOFF_HZ = 455.0
_HALF_LENGTH_MS = 32
_KAISER_BETA = 8.0
_GRID_TOLERANCE = 0.2
"""Periods by which a time may lie off the 1 kHz grid and still be on it."""
_RATE_TOLERANCE = 0.01
_EVEN = 0.1
"""Periods by which stamps may lie off regular times and count as even."""
_NEARLY = 1e-6
"""Periods by which rounding may put a time beside the grid."""


def resample(
    samples: Samples, stamps: Mapping[Channel, Stamps], longest_gap_s: float | None
) -> tuple[IntArray, dict[Channel, FloatArray]]:
    """Return the frame numbers (k,) and the channels (k, 3) at these.

    Frame number 0 is at the earliest time of all channels. A frame exists where every
    channel has samples around it that are no further apart than `longest_gap_s` (None:
    five of that channel's median intervals, within 5 to 100 ms); the others are missing.
    A stretch of fewer than two samples gives no frame. `samples` must have been checked.
    """
    origin_s = min(float(stamps[channel].time_s[0]) for channel in samples.values)
    numbers: IntArray | None = None
    resampled: dict[Channel, FloatArray] = {}
    for channel, values in samples.values.items():
        time_s = stamps[channel].time_s - origin_s
        present, rows = _resample_channel(
            time_s, values, longest_gap_s, even=_is_even(stamps[channel])
        )
        if numbers is None:
            numbers = present
        else:
            numbers, kept, new = np.intersect1d(
                numbers, present, assume_unique=True, return_indices=True
            )
            resampled = {name: earlier[kept] for name, earlier in resampled.items()}
            rows = rows[new]
        resampled[channel] = rows
    return (np.zeros(0, dtype=np.int64) if numbers is None else numbers), resampled


def _is_even(stamps: Stamps) -> bool:
    return stamps.regular or stamps.largest_s <= _EVEN * stamps.period_s


def _resample_channel(
    time_s: FloatArray, values: FloatArray, longest_gap_s: float | None, *, even: bool
) -> tuple[IntArray, FloatArray]:
    numbers = [np.zeros(0, dtype=np.int64)]
    rows = [np.zeros((0, values.shape[1]))]
    for begin, end in _stretches(time_s, longest_gap_s):
        stretch = time_s[begin:end]
        first = int(np.ceil(stretch[0] * RATE_HZ - _NEARLY))
        last = int(np.floor(stretch[-1] * RATE_HZ + _NEARLY))
        if end - begin < 2 or last < first:
            continue
        numbers.append(np.arange(first, last + 1))
        rows.append(_resample_stretch(stretch, values[begin:end], first, last, even=even))
    return np.concatenate(numbers), np.concatenate(rows)


def _stretches(time_s: FloatArray, longest_gap_s: float | None) -> Iterator[tuple[int, int]]:
    """Yield (begin, end) of the rows between the gaps."""
    intervals_s = np.diff(time_s)
    if longest_gap_s is None:
        several_s = DEFAULT_GAP_INTERVALS * float(np.median(intervals_s))
        longest_gap_s = min(max(DEFAULT_GAP_S[0], several_s), DEFAULT_GAP_S[1])
    longest_gap_s += _NEARLY / RATE_HZ
    cuts = (np.flatnonzero(intervals_s > longest_gap_s) + 1).tolist()
    yield from zip([0, *cuts], [*cuts, len(time_s)], strict=True)


def _resample_stretch(
    time_s: FloatArray, values: FloatArray, first: int, last: int, *, even: bool
) -> FloatArray:
    """Return the values (k, 3) at frames `first` to `last`, all within the times (n,)."""
    from scipy.interpolate import CubicSpline, PchipInterpolator
    from scipy.signal import resample_poly

    rate_hz = (len(time_s) - 1) / (time_s[-1] - time_s[0])
    # A clock that runs a percent fast needs no filter, only interpolation.
    factor = max(1, int(np.ceil(rate_hz / RATE_HZ - 0.01)))
    grid_s = np.arange(first * factor, last * factor + 1) / (RATE_HZ * factor)
    interpolator = (CubicSpline if even else PchipInterpolator)(time_s, values, axis=0)
    fine: FloatArray = interpolator(np.clip(grid_s, time_s[0], time_s[-1]))
    if factor == 1 or len(fine) == 1:
        return fine
    decimated: FloatArray = resample_poly(
        fine, 1, factor, axis=0, window=_anti_alias_filter(factor), padtype="line"
    )
    return decimated


@cache
def _anti_alias_filter(factor: int) -> FloatArray:
    """Return the filter's taps at `factor` times 1 kHz (Kaiser window)."""
    from scipy.signal import firwin

    taps: FloatArray = firwin(
        2 * _HALF_LENGTH_MS * factor + 1,
        _CUTOFF_HZ,
        window=("kaiser", _KAISER_BETA),
        fs=RATE_HZ * factor,
    )
    return taps


def to_frames(
    samples: Samples, longest_gap_s: float | None = None, choice: StampChoice = "auto"
) -> tuple[RecordArray, dict[Channel, Stamps], bool]:
    """Return samples as frames (n,) at 1 kHz, their times, and whether they were resampled.

    Rows on a 1 kHz grid, within a fifth of a period, become frames as they are; so do
    those of an exported session, which have their frame numbers. Everything else goes
    through `assess_stamps` and `resample`, which import scipy. `samples` must have been checked.

    Raises
    ------
    InputError
        Rows of a time are not of a clock, or the samples are too far apart to give a frame.
    """
    numbers = _frame_numbers(samples)
    if numbers is not None:
        time_s = next(iter(samples.times.values()))
        time_ns = np.rint((time_s - time_s[0]) * 1e9).astype(np.int64)
        kept = dict.fromkeys(samples.values, on_the_grid(time_s, numbers))
        return _frames(samples, numbers, time_ns, samples.values), kept, False
    require("scipy")
    stamps = _stamps(samples, choice)
    for channel, assessed in stamps.items():
        repeated = np.flatnonzero(np.diff(assessed.time_s) <= 0)
        if len(repeated):
            row = int(repeated[0]) + 1
            raise InputError(
                f"{samples.origin}: the time of {channel} is {assessed.time_s[row]:.9g} s in "
                f"{samples.row_name(channel, row)} and in the row before; such stamps can be "
                "used only where the rows follow a clock, and these do not (--rate HZ says the "
                "rows a second)"
            )
    numbers, values = resample(samples, stamps, longest_gap_s)
    return _frames(samples, numbers, numbers * FRAME_PERIOD_NS, values), stamps, True


def on_the_grid(time_s: FloatArray, numbers: IntArray) -> Stamps:
    """Return the stamps of frames: their times (n,), and how these lie to their numbers (n,)."""
    off_s = time_s - time_s[0] - (numbers - numbers[0]) / RATE_HZ
    off_s -= np.mean(off_s)
    return Stamps(
        time_s=time_s,
        period_s=1.0 / RATE_HZ,
        jitter_s=float(np.sqrt(np.mean(off_s**2))),
        largest_s=float(np.abs(off_s).max()),
        missing_rows=int(numbers[-1] - numbers[0]) + 1 - len(numbers),
        periodic=True,
        regular=False,
    )


def _stamps(samples: Samples, choice: StampChoice) -> dict[Channel, Stamps]:
    """Assess the times of each channel; channels of one rate are assessed together."""
    found: dict[int, Stamps] = {}
    for time_s in samples.times.values():
        if id(time_s) not in found:
            smooth = [
                samples.values[channel]
                for channel in ("position", "force")
                if samples.times.get(channel) is time_s
            ]
            found[id(time_s)] = assess_stamps(time_s, smooth[0] if smooth else None, choice)
    return {channel: found[id(time_s)] for channel, time_s in samples.times.items()}


def _frame_numbers(samples: Samples) -> IntArray | None:
    """Return the frame number of each row, None where the rows are not frames."""
    time_s = next(iter(samples.times.values()))
    if any(other is not time_s for other in samples.times.values()):
        return None
    periods = (time_s - time_s[0]) * 1000.0
    if samples.sequence is not None and len(samples.sequence) == len(periods):
        numbers = np.rint(samples.sequence)
        span = numbers[-1] - numbers[0]
        in_range = numbers[0] >= 0 and numbers[-1] < SEQUENCES
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
            f"{samples.origin}: no frame can be made: its channels share no time in which "
            "their samples are close enough together; are the times in seconds (else say their "
            "unit, as in --unit time=ms)? Otherwise allow a longer gap (--longest-gap), or move a "
            "file's times (--offset)"
        )
    channels = [channel for channel in CHANNELS if channel in values]
    frames = np.zeros(len(numbers), dtype=frame_dtype(channels))
    frames["sequence"] = numbers
    frames["time_ns"] = time_ns
    for channel in channels:
        frames[FIELD_OF_CHANNEL[channel]] = values[channel]
    return frames
