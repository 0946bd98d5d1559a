"""Resample a recording of any rate, or of uneven times: to 1 kHz, acceleration to k kHz.

Offline only; scipy is imported when needed. A cubic spline interpolates samples at regular times.
At uneven times a spline could overshoot without bound, so a monotone cubic (PCHIP) interpolates,
which stays between neighbouring samples. Samples faster than k kHz are first interpolated to a
whole multiple m of k kHz, then decimated by m with a linear-phase filter without delay: flat within
0.01 dB to 415 k Hz, 80 dB down above 495 k Hz, so that nothing aliases. With fewer than eight
samples in 1/k ms a spline is not flat enough: acceleration is then filtered directly at the output
times, unless these coincide with samples. Within 32/k ms of the ends of a stretch, the filter sees
the straight line between the ends continued. The cost is linear in the number of samples.
"""

from collections.abc import Iterator, Mapping
from functools import cache, reduce
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.frames import Channel
from mmt.core.rotations import without_flips
from mmt.session.importing.samples import Samples
from mmt.session.importing.stamps import Stamps

RATE_HZ: Final = 1000.0
DEFAULT_GAP_INTERVALS: Final = 5.0
DEFAULT_GAP_S: Final = (0.005, 0.1)
"""Bounds of the default for the longest gap that is interpolated."""

_CUTOFF_HZ = 455.0
"""Cutoff of the filter at 1 kHz; cutoff and length scale with the rate."""
_HALF_LENGTH_MS = 32
_KAISER_BETA = 8.0
_EVEN = 0.1
"""Largest deviation of even stamps from regular times, in periods."""
_NEARLY = 1e-6
"""Tolerance for the rounding of times on the grid, in periods."""
_AT_SAMPLES = 0.02
"""Distance from samples, in their periods, up to which a spline is as good as the samples."""
_MANY_SAMPLES = 8
"""Samples per output period from which a spline is flat, with images 60 dB down."""
_FAST_CLOCK = 0.01
"""Relative difference up to which a clock's rate counts as the output rate."""
_AT_ONCE: Final = 1 << 20
"""Products per step of the filter between samples; bounds memory."""


def resample(
    samples: Samples,
    stamps: Mapping[Channel, Stamps],
    longest_gap_s: float | None,
    samples_per_frame: int = 1,
) -> tuple[IntArray, dict[Channel, FloatArray]]:
    """Return frame numbers (n,) and channels (n, k, 3); k is `samples_per_frame` or 1 for motion.

    An orientation (n, 1, 4) is interpolated like a vector, and normalised.

    Frame number 0 is at the earliest time of all channels. A frame exists if every channel has
    samples around it that are no further apart than `longest_gap_s` (None: five of that
    channel's median intervals, but 5 to 100 ms). Other frames are missing. A stretch of fewer
    than two samples gives no frame. `samples` must have been checked.
    """
    origin_s = min(float(stamps[channel].time_s[0]) for channel in samples.values)
    found: dict[Channel, tuple[IntArray, FloatArray]] = {}
    for channel, values in samples.values.items():
        own = stamps[channel]
        vibrates = channel == "acceleration"
        several = samples_per_frame if vibrates else 1
        fine, rows = _resample_channel(
            own.time_s - origin_s,
            without_flips(values) if channel == "orientation" else values,
            longest_gap_s,
            RATE_HZ * several,
            even=own.regular or own.largest_s <= _EVEN * own.period_s,
            vibrates=vibrates,
        )
        present, first, counts = np.unique(
            -(-fine // several), return_index=True, return_counts=True
        )
        whole = counts == several
        rows = rows[first[whole][:, None] + np.arange(several)]
        if channel == "orientation":
            rows /= np.linalg.norm(rows, axis=2, keepdims=True)
        found[channel] = present[whole], rows
    numbers = reduce(np.intersect1d, (present for present, _ in found.values()))
    return numbers, {
        channel: rows[np.searchsorted(present, numbers)]
        for channel, (present, rows) in found.items()
    }


def _resample_channel(
    time_s: FloatArray,
    values: FloatArray,
    longest_gap_s: float | None,
    rate_hz: float,
    *,
    even: bool,
    vibrates: bool,
) -> tuple[IntArray, FloatArray]:
    """Return sample numbers (n,) at a rate, number 0 at time 0, and the samples (n, 3)."""
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
    """Yield (begin, end) of each stretch of rows between gaps."""
    intervals_s = np.diff(time_s)
    if longest_gap_s is None:
        several_s = DEFAULT_GAP_INTERVALS * float(np.median(intervals_s))
        longest_gap_s = min(max(DEFAULT_GAP_S[0], several_s), DEFAULT_GAP_S[1])
    longest_gap_s += _NEARLY / RATE_HZ
    cuts = (np.flatnonzero(intervals_s > longest_gap_s) + 1).tolist()
    yield from zip([0, *cuts], [*cuts, len(time_s)], strict=True)


class _Grid(NamedTuple):
    """Regular times at a rate: samples `first` to `last`, counted from time 0."""

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
    """Return the values (m, 3) on a grid that lies within the times (n,)."""
    from scipy.interpolate import CubicSpline, PchipInterpolator
    from scipy.signal import resample_poly

    rows_per_period = _rows_per_period(time_s, grid)
    # A clock that is one percent fast needs no filter, only interpolation.
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
    """Return a grid's fractional positions in even rows (n,), or None if a spline will do."""
    if not 1.0 - _FAST_CLOCK < _rows_per_period(time_s, grid) < _MANY_SAMPLES:
        return None
    at_rows: FloatArray = np.interp(grid.times_s(), time_s, np.arange(len(time_s)))
    return at_rows if np.abs(at_rows - np.rint(at_rows)).max() > _AT_SAMPLES else None


def _filtered_between(
    at_rows: FloatArray, values: FloatArray, rows_per_period: float
) -> FloatArray:
    """Low-pass even rows (n, 3) at fractional positions (m,); return values (m, 3).

    Rows at the output rate keep their whole band.
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
    """Return the taps (Kaiser window) for decimation by `factor`, designed for 1 kHz."""
    from scipy.signal import firwin

    taps: FloatArray = firwin(
        2 * _HALF_LENGTH_MS * factor + 1,
        _CUTOFF_HZ,
        window=("kaiser", _KAISER_BETA),
        fs=RATE_HZ * factor,
    )
    return taps
