"""Put the rows of a periodic source at regular times where only their stamps jitter.

A recording program stamps a row when it gets it: late by the transport, by the scheduler, or in
batches. A motion that is read along such stamps is torn: 0.6 ms at 500 Hz make a hand of 200 mm/s
jump by 0.1 mm from row to row. Offline only; cost is linear in the number of rows.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from mmt.core.arrays import FloatArray, IntArray

StampChoice = Literal["auto", "regular", "kept", "header", "receipt"]
"""How the times of rows are found; the last two are clocks of messages, else they are "auto"."""

_FEWEST_ROWS = 16
_WINDOW_ROWS: Final = 16
"""Rows on either side whose median tells a missing row from a late stamp."""
_PASSES = 5
_MISSING = 0.7
"""Periods by which what follows a row must be later than what precedes it."""
_BLOCK_WINDOWS = 4
_LINE_WINDOWS = 512
"""Windows of rows that one line is fitted to."""
_FITTED_SHARE = 0.9
"""Share of the rows that must follow a clock; the others lie on lines of its period."""
_OWN_RHYTHM = 0.15
"""Periods by which intervals may lie off whole ones where stamps have a rhythm of their own."""
_IN_BATCHES = 0.25
"""Mean intervals below which most are where rows arrive in batches."""
_BATCH_SPREAD = 0.25
"""Intervals between batches by which their beginnings may lie off a clock's times."""
_MUCH_BETTER = 0.5
"""Share of the stamps' error that a clock may leave which does not explain the stamps."""
_SHORTEST_PAUSE_S = 0.1
_PAUSE_PERIODS = 20
"""Periods without a row, beyond which the source may have started anew, at any phase."""


@dataclass(frozen=True, eq=False)
class Stamps:
    """The times at which the rows of a recording are taken to have been sampled."""

    time_s: FloatArray
    """Shape (n,), increasing."""
    period_s: float
    """Mean of the source's period, or of the intervals where it has none."""
    jitter_s: float
    """Root mean square of what stamps lie off a clock; intervals off whole periods, without one."""
    largest_s: float
    """The largest of these."""
    missing_rows: int
    """Rows that are missing between the others."""
    periodic: bool
    """Whether the stamps follow a clock."""
    regular: bool
    """Whether `time_s` are regular times in place of the stamps."""


def assess_stamps(
    stamps_s: FloatArray, rows: FloatArray | None = None, choice: StampChoice = "auto"
) -> Stamps:
    """Find the period behind the stamps of a recording, and the times of its rows.

    The rows of a periodic source are numbered, rows that are missing included, and a line
    through their stamps gives their times. After a pause of the source the line begins anew.

    Parameters
    ----------
    stamps_s
        Shape (n,), not falling.
    rows
        Values (n, k) that change smoothly, such as position; they decide for "auto" whether the
        jitter is of the stamps or of the sampling: each second row is predicted by the line
        between its neighbours, and the times that predict better are taken. None takes
        regular times for a periodic source.
    choice
        "regular" for regular times wherever the source is periodic, "kept" for the stamps.
    """
    if choice in ("header", "receipt"):
        choice = "auto"
    kept, own_s = _as_they_are(stamps_s)
    line = _fit(stamps_s) if len(stamps_s) >= _FEWEST_ROWS else None
    if line is None:
        return kept
    off_s = stamps_s - line.time_s
    explained = _explains(off_s, np.diff(stamps_s), own_s)
    share = 1.0 if rows is None else _error_share(line.time_s, stamps_s, rows)
    better = share <= (1.0 if explained else _MUCH_BETTER)
    regular = choice == "regular" or (choice == "auto" and better)
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
    """Return the stamps, and what their intervals lie off whole periods of their own."""
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
    """Whether stamps lie `off_s` (n,) off a clock by no more than off a rhythm of their own.

    Where rows arrive in batches they have none; then the batches must begin at the clock's times.
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
    """Fit a line to each stretch between pauses; None where too few rows follow a clock."""
    intervals_s = np.diff(stamps_s)
    window = _WINDOW_ROWS * _batch_rows(intervals_s)
    typical_s = _slope(stamps_s, np.arange(len(stamps_s)), window)
    if typical_s <= 0:  # most rows have the stamp of the row before
        return None
    pause_s = max(_SHORTEST_PAUSE_S, _PAUSE_PERIODS * typical_s, 2 * window * typical_s)
    cuts = np.flatnonzero(intervals_s > pause_s) + 1
    # a clock wanders within minutes, and a missing row may have passed unseen
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
    """Join lines and count their rows on; one that begins too early is moved behind the last."""
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
    """Fit a line to rows of which none, or some, are missing, whichever leaves least; or None."""
    best: tuple[float, _Line] | None = None
    in_steps = np.cumsum([0, *_whole_periods(np.diff(stamps_s))])
    block = min(_BLOCK_WINDOWS * window, len(stamps_s) // 4)
    for numbers in (np.arange(len(stamps_s)), _with_missing(stamps_s, window), in_steps):
        period_s, time_s = _through(stamps_s, numbers, block)
        off_s = stamps_s - time_s
        drift_s = np.quantile(np.abs(_block_medians(off_s, block)), 0.9)
        left_s = float(np.mean(np.abs(off_s)))
        if drift_s > period_s / 2 + 4.0 * left_s / np.sqrt(block):  # four deviations of a median
            continue
        if best is None or left_s < best[0]:
            best = (left_s, _Line(numbers, period_s, time_s))
    return None if best is None else best[1]


def _whole_periods(intervals_s: FloatArray) -> IntArray:
    """Return intervals (n,) in periods, the mean of those that are no longer than most."""
    median_s = np.median(intervals_s)
    period_s = np.mean(intervals_s[intervals_s <= 1.5 * median_s])
    return np.maximum(1, np.rint(intervals_s / (period_s or np.inf))).astype(np.int64)


def _with_missing(stamps_s: FloatArray, window: int) -> IntArray:
    """Return the numbers (n,) of rows, counted in periods; where rows are missing they jump.

    A row that is stamped late is followed by rows in time, a missing one is not: the medians
    of what the stamps lie off the numbers, before and after, tell them apart.
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
        # a later pass takes back what an earlier one counted too much
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
    """Return those of the places, rising, that have the largest size within a window of rows."""
    chosen: list[int] = []
    for place in places.tolist():
        if chosen and place - chosen[-1] < window:
            chosen[-1] = max(chosen[-1], place, key=sizes.__getitem__)
        else:
            chosen.append(place)
    return np.array(chosen, dtype=np.int64)


def _batch_rows(intervals_s: FloatArray) -> int:
    """Return how many rows arrive at once, 1 where each has a stamp of its own."""
    apart = np.flatnonzero(intervals_s > 0.5 * np.mean(intervals_s))
    return max(1, int(np.median(np.diff(apart)))) if len(apart) > 1 else 1


def _slope(stamps_s: FloatArray, numbers: IntArray, lag: int) -> float:
    """Return the median period over `lag` rows: single late stamps do not move it."""
    lag = min(lag, len(stamps_s) // 2)
    return float(np.median((stamps_s[lag:] - stamps_s[:-lag]) / (numbers[lag:] - numbers[:-lag])))


def _through(stamps_s: FloatArray, numbers: IntArray, rows: int) -> tuple[float, FloatArray]:
    """Return slope and times of the line through medians of `rows` rows; late ones do not count."""
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


def _error_share(regular_s: FloatArray, stamps_s: FloatArray, rows: FloatArray) -> float:
    """Return by what share of the stamps' error regular times predict each second row."""
    least = np.finfo(float).tiny  # both predict a constant
    return (_prediction_error(regular_s, rows) + least) / (
        _prediction_error(stamps_s, rows) + least
    )


def _prediction_error(time_s: FloatArray, rows: FloatArray) -> float:
    span_s = time_s[2:] - time_s[:-2]
    valid = span_s > 0
    share = ((time_s[1:-1] - time_s[:-2])[valid] / span_s[valid])[:, None]
    predicted = (1.0 - share) * rows[:-2][valid] + share * rows[2:][valid]
    return float(np.mean(np.abs(rows[1:-1][valid] - predicted)))
