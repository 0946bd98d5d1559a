"""Resample a recording of any rate, or of uneven times: to 1 kHz, acceleration to k kHz.

Offline only; scipy is imported where a recording needs to be resampled. Between samples at regular
times a cubic spline interpolates; between uneven ones, where a spline would overshoot without
bound, a monotone cubic (PCHIP), which stays between each two samples. What is faster than k kHz is
first brought to a whole multiple m of k kHz, then filtered and decimated by m with a linear-phase
filter of no delay: flat within 0.01 dB to 415 k Hz, 80 dB down above 495 k Hz, so that nothing
folds back. A spline through fewer than eight samples in 1/k ms would not be so flat itself:
acceleration is then filtered at the wanted times, unless these are those of samples.
Within 32/k ms of the ends of a stretch the filter sees the straight line between the ends
continued. Cost is linear in the number of samples.
"""

from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.frames import (
    CHANNELS,
    FIELD_OF_CHANNEL,
    MOST_SAMPLES,
    SEQUENCES,
    Channel,
    frame_dtype,
)
from mmt.session.data import FRAME_PERIOD_NS, sample_times_s
from mmt.session.importing.samples import Samples
from mmt.session.importing.stamps import StampChoice, Stamps, assess_stamps

RATE_HZ: Final = 1000.0
DEFAULT_GAP_INTERVALS: Final = 5.0
DEFAULT_GAP_S: Final = (0.005, 0.1)
"""Bounds of the default for the longest gap that is interpolated."""

_CUTOFF_HZ = 455.0
"""Of the filter at 1 kHz; it and the length scale with the rate."""
_HALF_LENGTH_MS = 32
_KAISER_BETA = 8.0
_GRID_TOLERANCE = 0.2
"""Periods by which a time may lie off the 1 kHz grid and still be on it."""
_RATE_TOLERANCE = 0.01
_EVEN = 0.1
"""Periods by which stamps may lie off regular times and count as even."""
_NEARLY = 1e-6
"""Periods by which rounding may put a time beside the grid."""
_AT_SAMPLES = 0.02
"""Periods off samples at which a spline through these is as good as they."""
_MANY_SAMPLES = 8
"""Samples in a period of the result whose spline is flat, with images 60 dB down."""
_FAST_CLOCK = 0.01
"""Share by which a clock may run fast or slow and still have the rate of the result."""
_AT_ONCE: Final = 1 << 20
"""Products that the filter between samples sums up at once."""


def resample(
    samples: Samples,
    stamps: Mapping[Channel, Stamps],
    longest_gap_s: float | None,
    samples_per_frame: int = 1,
) -> tuple[IntArray, dict[Channel, FloatArray]]:
    """Return the frame numbers (n,) and the channels (n, k, 3) at these, k = 1 but of acceleration.

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
        vibrates = channel == "acceleration"
        several = samples_per_frame if vibrates else 1
        fine, rows = _resample_channel(
            time_s,
            values,
            longest_gap_s,
            RATE_HZ * several,
            even=_is_even(stamps[channel]),
            vibrates=vibrates,
        )
        present, first, counts = np.unique(
            -(-fine // several), return_index=True, return_counts=True
        )
        whole = counts == several
        present = present[whole]
        rows = rows[first[whole][:, None] + np.arange(several)]
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
    time_s: FloatArray,
    values: FloatArray,
    longest_gap_s: float | None,
    rate_hz: float,
    *,
    even: bool,
    vibrates: bool,
) -> tuple[IntArray, FloatArray]:
    """Return the numbers (n,) of samples at a rate, 0 at the time 0, and these, (n, 3)."""
    numbers = [np.zeros(0, dtype=np.int64)]
    rows = [np.zeros((0, values.shape[1]))]
    for begin, end in _stretches(time_s, longest_gap_s):
        stretch = time_s[begin:end]
        first = int(np.ceil(stretch[0] * rate_hz - _NEARLY))
        last = int(np.floor(stretch[-1] * rate_hz + _NEARLY))
        if end - begin < 2 or last < first:
            continue
        numbers.append(np.arange(first, last + 1))
        grid = _Grid(first, last, rate_hz)
        stretch_rows = values[begin:end]
        if even and vibrates and (at_rows := _between(stretch, grid)) is not None:
            rows.append(_filtered_between(at_rows, stretch_rows, _rows_per_period(stretch, grid)))
        else:
            rows.append(_resample_stretch(stretch, stretch_rows, grid, even=even))
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


class _Grid(NamedTuple):
    """Times at a rate: of the numbers `first` to `last`, counted from the time 0."""

    first: int
    last: int
    rate_hz: float

    def times_s(self, factor: int = 1) -> FloatArray:
        """Return the times at a multiple of the rate."""
        numbers = np.arange(self.first * factor, self.last * factor + 1)
        return numbers / (self.rate_hz * factor)


def _resample_stretch(
    time_s: FloatArray, values: FloatArray, grid: _Grid, *, even: bool
) -> FloatArray:
    """Return the values (m, 3) at a grid all of which lies within the times (n,)."""
    from scipy.interpolate import CubicSpline, PchipInterpolator
    from scipy.signal import resample_poly

    rows_per_period = _rows_per_period(time_s, grid)
    # A clock that runs a percent fast needs no filter, only interpolation.
    factor = max(1, int(np.ceil(rows_per_period - _FAST_CLOCK)))
    grid_s = grid.times_s(factor)
    interpolator = (CubicSpline if even else PchipInterpolator)(time_s, values, axis=0)
    fine: FloatArray = interpolator(np.clip(grid_s, time_s[0], time_s[-1]))
    if factor == 1 or len(fine) == 1:
        return fine
    decimated: FloatArray = resample_poly(
        fine, 1, factor, axis=0, window=_anti_alias_filter(factor), padtype="line"
    )
    return decimated


def _rows_per_period(time_s: FloatArray, grid: _Grid) -> float:
    return float((len(time_s) - 1) / (time_s[-1] - time_s[0]) / grid.rate_hz)


def _between(time_s: FloatArray, grid: _Grid) -> FloatArray | None:
    """Return where a grid lies in even rows (n,), None where a spline through them will do."""
    if not 1.0 - _FAST_CLOCK < _rows_per_period(time_s, grid) < _MANY_SAMPLES:
        return None
    at_rows: FloatArray = np.interp(grid.times_s(), time_s, np.arange(len(time_s)))
    return at_rows if np.abs(at_rows - np.rint(at_rows)).max() > _AT_SAMPLES else None


def _filtered_between(
    at_rows: FloatArray, values: FloatArray, rows_per_period: float
) -> FloatArray:
    """Return the values (n, 3) of even rows, low-passed, at rows (m,) that need not be whole.

    What has the rate of the result keeps all of its band.
    """
    from scipy.special import i0

    half = _HALF_LENGTH_MS * rows_per_period
    slower = rows_per_period > 1.0 + _FAST_CLOCK
    bandwidth = 2.0 * _CUTOFF_HZ / RATE_HZ / rows_per_period if slower else 1.0
    reach = int(np.ceil(half))
    line = np.linspace(values[0], values[-1], len(values))
    padded = np.pad(values - line, ((reach, reach), (0, 0)))
    offsets = np.arange(1 - reach, reach + 1)
    filtered: FloatArray = np.empty((len(at_rows), values.shape[1]))
    step = max(1, _AT_ONCE // len(offsets))
    for begin in range(0, len(at_rows), step):
        at = at_rows[begin : begin + step]
        before = np.floor(at).astype(np.int64)
        away = offsets - (at - before)[:, None]
        inside = np.sqrt(np.clip(1.0 - (away / half) ** 2, 0.0, None))
        weights = np.sinc(bandwidth * away) * i0(_KAISER_BETA * inside)
        weights[np.abs(away) > half] = 0.0
        weights /= weights.sum(axis=1, keepdims=True)
        near = padded[before[:, None] + reach + offsets]
        filtered[begin : begin + step] = np.einsum("mt,mtc->mc", weights, near)
    filtered += np.column_stack([np.interp(at_rows, np.arange(len(line)), one) for one in line.T])
    return filtered


@cache
def _anti_alias_filter(factor: int) -> FloatArray:
    """Return the filter's taps at `factor` times the rate (Kaiser window), as of 1 kHz."""
    from scipy.signal import firwin

    taps: FloatArray = firwin(
        2 * _HALF_LENGTH_MS * factor + 1,
        _CUTOFF_HZ,
        window=("kaiser", _KAISER_BETA),
        fs=RATE_HZ * factor,
    )
    return taps


class _Rows(NamedTuple):
    """Rows that are frames: number and time of each, (n,), and how many samples it has."""

    numbers: IntArray
    time_s: FloatArray
    samples_per_frame: int
    exported: bool
    """Whether the numbers are those of an exported session."""


def to_frames(
    samples: Samples,
    longest_gap_s: float | None = None,
    choice: StampChoice = "auto",
    acceleration_rate_hz: int | None = None,
) -> tuple[RecordArray, dict[Channel, Stamps], bool]:
    """Return samples as frames (n,) at 1 kHz, their times, and whether they were resampled.

    Rows on a 1 kHz grid, within a fifth of a period, become frames as they are, those of the
    acceleration on that of the rate at which it is kept; so do those of an exported session, which
    have their frame numbers. Everything else goes through `assess_stamps` and `resample`, which
    import scipy. `samples` must have been checked.

    Raises
    ------
    InputError
        Rows of a time are not of a clock, or the samples are too far apart to give a frame.
    """
    rows = _as_frames(samples)
    if acceleration_rate_hz is None:
        several = rows.samples_per_frame if rows and rows.exported else 1
    else:
        several = acceleration_rate_hz // round(RATE_HZ) if "acceleration" in samples.values else 1
    if rows and rows.samples_per_frame == several:
        time_ns = np.rint((rows.time_s - rows.time_s[0]) * 1e9).astype(np.int64)
        kept = on_the_grid(samples.values, rows.time_s, rows.numbers, several)
        return _frames(samples, rows.numbers, time_ns, samples.values, several), kept, False
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
    numbers, values = resample(samples, stamps, longest_gap_s, several)
    return _frames(samples, numbers, numbers * FRAME_PERIOD_NS, values, several), stamps, True


def on_the_grid(
    channels: Iterable[Channel], time_s: FloatArray, numbers: IntArray, samples_per_frame: int
) -> dict[Channel, Stamps]:
    """Return the stamps of each channel of frames at times (n,), which have numbers (n,)."""
    motion, acceleration = (
        _of_frames(time_s, numbers, several) for several in (1, samples_per_frame)
    )
    return {each: acceleration if each == "acceleration" else motion for each in channels}


def _of_frames(time_s: FloatArray, numbers: IntArray, samples_per_frame: int) -> Stamps:
    """Return the stamps of a number of samples a frame, and how these lie to the numbers."""
    off_s = time_s - time_s[0] - (numbers - numbers[0]) / RATE_HZ
    off_s -= np.mean(off_s)
    missing = int(numbers[-1] - numbers[0]) + 1 - len(numbers)
    return Stamps(
        time_s=sample_times_s(time_s, samples_per_frame),
        period_s=1.0 / (RATE_HZ * samples_per_frame),
        jitter_s=float(np.sqrt(np.mean(off_s**2))),
        largest_s=float(np.abs(off_s).max()),
        missing_rows=samples_per_frame * missing,
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


def _as_frames(samples: Samples) -> _Rows | None:
    """Return the rows as frames, None if they are none."""
    times, sequence = dict(samples.times), samples.sequence
    fast_s = times.pop("acceleration", None)
    time_s = next(iter(times.values()), fast_s)
    several = 1
    if time_s is None or any(other is not time_s for other in times.values()):
        return None
    if fast_s is not None:
        count = len(time_s) if times or sequence is None else len(sequence)
        several, rest = divmod(len(fast_s), max(1, count))
        if rest or not 1 <= several <= MOST_SAMPLES:
            several = 1
        if not times:
            time_s = fast_s[several - 1 :: several]
        elif several == 1 and fast_s is not time_s:
            return None
        off_s = fast_s - sample_times_s(time_s, several)
        if np.abs(off_s).max() > _GRID_TOLERANCE / (RATE_HZ * several):
            return None
    numbers = _frame_numbers(time_s, sequence)
    if numbers is None:
        return None
    return _Rows(numbers, time_s, several, sequence is not None)


def _frame_numbers(time_s: FloatArray, sequence: FloatArray | None) -> IntArray | None:
    """Return the numbers of frames at these times (n,), None if they are none."""
    periods = (time_s - time_s[0]) * 1000.0
    if sequence is not None and len(sequence) == len(periods):
        numbers = np.rint(sequence)
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
    samples_per_frame: int,
) -> RecordArray:
    if len(numbers) == 0:
        raise InputError(
            f"{samples.origin}: no frame can be made: its channels share no time in which "
            "their samples are close enough together; are the times in seconds (else say their "
            "unit, as in --unit time=ms)? Otherwise allow a longer gap (--longest-gap), or move a "
            "file's times (--offset)"
        )
    channels = [channel for channel in CHANNELS if channel in values]
    frames = np.zeros(len(numbers), dtype=frame_dtype(channels, samples_per_frame))
    frames["sequence"] = numbers
    frames["time_ns"] = time_ns
    for channel in channels:
        field = frames[FIELD_OF_CHANNEL[channel]]
        field[...] = values[channel].reshape(field.shape)
    return frames
