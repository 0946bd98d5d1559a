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

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.frames import Channel
from mmt.session.importing.samples import Samples
from mmt.session.importing.stamps import Stamps

RATE_HZ: Final = 1000.0
DEFAULT_GAP_INTERVALS: Final = 5.0
DEFAULT_GAP_S: Final = (0.005, 0.1)
"""Bounds of the default for the longest gap that is interpolated."""

_CUTOFF_HZ = 455.0
"""Of the filter at 1 kHz; it and the length scale with the rate."""
_HALF_LENGTH_MS = 32
_KAISER_BETA = 8.0
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
