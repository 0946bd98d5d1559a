"""Replace jittered time stamps of a periodic source by regular times.

A recording program stamps a row when it receives it: late because of the transport or the
scheduler, or in batches. Such stamps distort motion: with 0.6 ms of jitter at 500 Hz, a hand of
200 mm/s jumps by 0.1 mm from row to row. Offline only; the cost is linear in the number of rows.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from mmt.core.arrays import FloatArray, IntArray

StampChoice = Literal["auto", "regular", "kept", "header", "receipt"]
"""Source of the times of rows. The last two select a clock of messages; other files take "auto"."""

_FEWEST_ROWS = 16
_WINDOW_ROWS: Final = 16
"""Rows on either side whose medians distinguish a missing row from a late stamp."""
_PASSES = 5
_MISSING = 0.7
"""Step of the median deviation, in periods, that counts as a missing row."""
_BLOCK_WINDOWS = 4
_LINE_WINDOWS = 512
"""Most windows of rows to which one line is fitted."""
_FITTED_SHARE = 0.9
"""Least share of the rows that lines fit; the other rows get lines with the median period."""
_OWN_RHYTHM = 0.15
"""Mean deviation from whole periods, in periods, below which intervals have their own rhythm."""
_IN_BATCHES = 0.25
"""Ratio of median to mean interval below which rows arrive in batches."""
_BATCH_SPREAD = 0.25
"""Largest spread of the beginnings of batches about a clock, in intervals between batches."""
_MUCH_BETTER = 0.5
"""Largest ratio of prediction errors, clock to stamps, to use a clock if `_explains` is false."""
_SHORTEST_PAUSE_S = 0.1
"""Least time without a row after which the source may have restarted with another phase."""


@dataclass(frozen=True, eq=False)
class Stamps:
    """Sampling times of a recording's rows, as estimated from their stamps."""

    time_s: FloatArray
    """Shape (n,), increasing."""
    period_s: float
    """Period of the source's clock; without a clock the median interval."""
    jitter_s: float
    """RMS deviation of stamps from the clock; without a clock, of intervals from whole periods."""
    largest_s: float
    """Largest deviation."""
    missing_rows: int
    """Number of missing rows."""
    periodic: bool
    """Whether the stamps follow a clock."""
    regular: bool
    """Whether `time_s` are regular times instead of the stamps."""


def assess_stamps(
    stamps_s: FloatArray, rows: FloatArray | None = None, choice: StampChoice = "auto"
) -> Stamps:
    """Estimate the period of a recording's source and the sampling times of the rows.

    The rows of a periodic source are numbered, with missing rows counted, and a line through
    their stamps gives their times. A new line starts after a pause of the source.

    Parameters
    ----------
    stamps_s
        Stamps, shape (n,), not decreasing.
    rows
        Values (n, k) that change smoothly, such as position. With "auto" they decide whether the
        stamps or the sampling times jitter: each inner row is predicted by linear interpolation
        between its neighbours, and the times with the better prediction are used. None: use
        regular times for a periodic source.
    choice
        "regular" for regular times if the source is periodic, "kept" for the stamps; any other
        is "auto".
    """
    kept, own_s = _as_they_are(stamps_s)
    line = _fit(stamps_s) if len(stamps_s) >= _FEWEST_ROWS else None
    if line is None:
        return kept
    off_s = stamps_s - line.time_s
    explained = _explains(off_s, np.diff(stamps_s), own_s)
    most = 1.0 if explained else _MUCH_BETTER
    better = _prediction_error(line.time_s, rows) <= most * _prediction_error(stamps_s, rows)
    regular = choice == "regular" or (choice != "kept" and better)
    if not (explained or regular):
        return kept
    return Stamps(
        time_s=line.time_s if regular else stamps_s,
        period_s=line.period_s,
        jitter_s=float(np.sqrt(np.mean(off_s**2))),
        largest_s=float(np.abs(off_s).max()),
        missing_rows=int(line.numbers[-1]) + 1 - len(stamps_s),
        periodic=True,
        regular=regular,
    )


def _as_they_are(stamps_s: FloatArray) -> tuple[Stamps, float]:
    """Assess the stamps without a clock; also return their mean deviation from whole periods."""
    intervals_s: FloatArray = np.diff(stamps_s)
    period_s = float(np.median(intervals_s) or np.mean(intervals_s))
    steps = _whole_periods(intervals_s)
    own_s = np.abs(intervals_s - steps * period_s)
    in_step = bool(np.mean(own_s) < _OWN_RHYTHM * period_s)
    uneven_s = own_s if in_step else np.abs(intervals_s - np.mean(intervals_s))
    kept = Stamps(
        time_s=stamps_s,
        period_s=period_s,
        jitter_s=float(np.sqrt(np.mean(uneven_s**2))),
        largest_s=float(uneven_s.max()),
        missing_rows=int(np.sum(steps - 1)) if in_step else 0,
        periodic=False,
        regular=False,
    )
    return kept, float(np.mean(own_s))


def _explains(off_s: FloatArray, intervals_s: FloatArray, own_s: float) -> bool:
    """Return whether deviations from a clock, `off_s` (n,), have a median of at most 2 `own_s`.

    If rows arrive in batches, the beginnings of the batches must follow the clock instead.
    """
    if np.median(intervals_s) >= _IN_BATCHES * np.mean(intervals_s):
        return bool(np.median(np.abs(off_s)) <= 2.0 * own_s)
    gaps = np.flatnonzero(intervals_s > 0.5 * np.mean(intervals_s))
    spread_s = np.median(np.abs(off_s[gaps + 1] - np.median(off_s[gaps + 1])))
    return bool(spread_s <= _BATCH_SPREAD * np.median(intervals_s[gaps]))


@dataclass(frozen=True, eq=False)
class _Line:
    """Rows that follow a clock: their numbers (n,), counted in periods, and regular times (n,)."""

    numbers: IntArray
    period_s: float
    time_s: FloatArray


def _fit(stamps_s: FloatArray) -> _Line | None:
    """Fit a line to each stretch between pauses; None if too few rows follow a clock."""
    intervals_s = np.diff(stamps_s)
    window = _WINDOW_ROWS * _batch_rows(intervals_s)
    typical_s = _slope(stamps_s, np.arange(len(stamps_s)), window)
    if typical_s <= 0:  # most rows have the same stamp as the previous row
        return None
    pause_s = max(_SHORTEST_PAUSE_S, 2 * window * typical_s)
    cuts = np.flatnonzero(intervals_s > pause_s) + 1
    # limited in length: a clock drifts within minutes, and a missing row may go undetected
    stretches = [
        stretch[begin : begin + _LINE_WINDOWS * window]
        for stretch in np.split(stamps_s, cuts)
        for begin in range(0, len(stretch), _LINE_WINDOWS * window)
    ]
    fewest = 4 * _BLOCK_WINDOWS * window
    fitted = [_fit_stretch(s, window) if len(s) >= fewest else None for s in stretches]
    fits = [line for line in fitted if line is not None]
    if not fits:
        fits = [line for line in [_fit_stretch(max(stretches, key=len), window)] if line]
    periods = [line.period_s for line in fits]
    long_rows = sum(len(stretch) for stretch in stretches if len(stretch) >= fewest)
    if not fits or sum(len(line.numbers) for line in fits) < _FITTED_SHARE * long_rows:
        return None
    return _joined(
        [
            line or _short_line(stretch, float(np.median(periods)))
            for line, stretch in zip(fitted, stretches, strict=True)
        ]
    )


def _joined(lines: list[_Line]) -> _Line:
    """Join lines and continue their numbers; a line that begins too early is moved later."""
    numbers, times_s = [lines[0].numbers], [lines[0].time_s]
    for line in lines[1:]:
        pause_s = line.time_s[0] - times_s[-1][-1]
        times_s.append(line.time_s + max(0.0, line.period_s / 2 - pause_s))
        numbers.append(line.numbers + numbers[-1][-1] + max(1, round(pause_s / line.period_s)))
    period_s = float(np.median([line.period_s for line in lines]))
    return _Line(np.concatenate(numbers), period_s, np.concatenate(times_s))


def _short_line(stamps_s: FloatArray, period_s: float) -> _Line:
    regular_s = period_s * np.arange(len(stamps_s))
    return _Line(np.arange(len(stamps_s)), period_s, regular_s + np.median(stamps_s - regular_s))


def _fit_stretch(stamps_s: FloatArray, window: int) -> _Line | None:
    """Fit a line for each way of counting missing rows; return the best, or None if none fits."""
    best: tuple[float, _Line] | None = None
    in_steps = np.cumsum([0, *_whole_periods(np.diff(stamps_s))])
    block = min(_BLOCK_WINDOWS * window, len(stamps_s) // 4)
    for numbers in (np.arange(len(stamps_s)), _with_missing(stamps_s, window), in_steps):
        period_s, time_s = _through(stamps_s, numbers, block)
        if period_s <= np.spacing(np.abs(stamps_s).max()):  # rows of one time
            continue
        off_s = stamps_s - time_s
        drift_s = np.quantile(np.abs(_block_medians(off_s, block)), 0.9)
        left_s = float(np.mean(np.abs(off_s)))
        if drift_s > period_s / 2 + 4.0 * left_s / np.sqrt(block):  # four deviations of a median
            continue
        if best is None or left_s < best[0]:
            best = (left_s, _Line(numbers, period_s, time_s))
    return None if best is None else best[1]


def _whole_periods(intervals_s: FloatArray) -> IntArray:
    """Return intervals (n,) in whole periods, a period being the mean of the short intervals."""
    median_s = np.median(intervals_s)
    period_s = np.mean(intervals_s[intervals_s <= 1.5 * median_s])
    return np.maximum(1, np.rint(intervals_s / (period_s or np.inf))).astype(np.int64)


def _with_missing(stamps_s: FloatArray, window: int) -> IntArray:
    """Return the numbers (n,) of rows, in periods, with a jump at missing rows.

    After a late stamp the following rows are on time again, after a missing row they are not.
    The medians of the stamps' deviations before and after a row distinguish the two cases.
    """
    from scipy.ndimage import median_filter

    window = min(window, len(stamps_s) // 4)
    numbers: IntArray = np.arange(len(stamps_s))
    for _ in range(_PASSES):
        period_s = _slope(stamps_s, numbers, window)
        if period_s <= 0:
            break
        off = stamps_s / period_s - numbers
        before = median_filter(off, window, mode="nearest", origin=(window - 1) // 2)[:-1]
        after = median_filter(off, window, mode="nearest", origin=-(window // 2))[1:]
        # a later pass may correct missing rows that an earlier pass counted wrongly
        missing = np.maximum(after - before, 1 - np.diff(numbers))
        steps = np.where(missing > 0, np.diff(off), -np.diff(off))
        chosen = _largest_nearby(np.flatnonzero(np.abs(missing) > _MISSING), steps, window)
        if not len(chosen):
            break
        lost = np.zeros_like(numbers)
        lost[chosen + 1] = np.rint(missing[chosen])
        numbers = numbers + np.cumsum(lost)
    return numbers


def _largest_nearby(places: IntArray, sizes: FloatArray, window: int) -> IntArray:
    """Return, of ascending `places`, the one with the largest size within each window of rows."""
    chosen: list[int] = []
    for place in places.tolist():
        if chosen and place - chosen[-1] < window:
            chosen[-1] = max(chosen[-1], place, key=sizes.__getitem__)
        else:
            chosen.append(place)
    return np.array(chosen, dtype=np.int64)


def _batch_rows(intervals_s: FloatArray) -> int:
    """Return how many rows arrive at once; 1 if each has its own stamp."""
    apart = np.flatnonzero(intervals_s > 0.5 * np.mean(intervals_s))
    return max(1, int(np.median(np.diff(apart)))) if len(apart) > 1 else 1


def _slope(stamps_s: FloatArray, numbers: IntArray, lag: int) -> float:
    """Return the median period over `lag` rows, which single late stamps do not affect."""
    lag = min(lag, len(stamps_s) // 2)
    return float(np.median((stamps_s[lag:] - stamps_s[:-lag]) / (numbers[lag:] - numbers[:-lag])))


def _through(stamps_s: FloatArray, numbers: IntArray, rows: int) -> tuple[float, FloatArray]:
    """Return slope and times of a line through medians of `rows` rows, robust to late stamps."""
    first_s = (stamps_s[-1] - stamps_s[0]) / (numbers[-1] - numbers[0])
    off_s = _block_medians(stamps_s - first_s * numbers, rows)
    centres = np.mean(numbers[: len(off_s) * rows].reshape(-1, rows), axis=1)
    centred = centres - np.mean(centres)
    period_s = float(first_s + np.dot(centred, off_s) / np.dot(centred, centred))
    return period_s, period_s * numbers + np.median(stamps_s - period_s * numbers)


def _block_medians(values: FloatArray, block: int) -> FloatArray:
    block = min(block, len(values))
    rows = len(values) // block * block
    return np.asarray(np.median(values[:rows].reshape(-1, block), axis=1))


def _prediction_error(time_s: FloatArray, rows: FloatArray | None) -> float:
    """Return the mean error of rows (n, k) that are predicted from their neighbours, above 0."""
    least = float(np.finfo(float).tiny)
    if rows is None:
        return least
    span_s = time_s[2:] - time_s[:-2]
    valid = span_s > 0
    share = ((time_s[1:-1] - time_s[:-2])[valid] / span_s[valid])[:, None]
    predicted = (1.0 - share) * rows[:-2][valid] + share * rows[2:][valid]
    return float(np.mean(np.abs(rows[1:-1][valid] - predicted))) + least
