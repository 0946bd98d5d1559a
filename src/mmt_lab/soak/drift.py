"""Drift of a figure in a long run: whether the figure stays level or grows."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.stats import theilslopes

from mmt.core.arrays import BoolArray, FloatArray

LEAST_WINDOWS: Final = 5
"""Least number of windows for an estimate."""


@dataclass(frozen=True)
class Drift:
    """Drift of a figure in a run.

    ``span_s`` is the time from its first window to the last; ``typical`` is its median. ``growth``
    is the span times the median slope between any two windows (Theil and Sen), ``least_growth`` the
    span times the lower end of that slope's 95 % confidence interval. The last three are None if
    there were too few windows.
    """

    windows: int
    span_s: float
    typical: float | None = None
    growth: float | None = None
    least_growth: float | None = None

    def within(self, allowed: float) -> bool:
        """Return whether no growth beyond `allowed` is proven."""
        return self.least_growth is None or self.least_growth <= allowed


def drift(times_s: FloatArray, values: FloatArray) -> Drift:
    """Return the drift of a figure (n,) with its times (n,).

    The estimate withstands disturbed windows, up to 29 % of them.
    """
    span_s = float(np.ptp(times_s)) if len(times_s) else 0.0
    if len(values) < LEAST_WINDOWS:
        return Drift(len(values), span_s)
    slope, _, low, _ = theilslopes(values, times_s, 0.95)
    return Drift(
        len(values), span_s, float(np.median(values)), float(slope) * span_s, float(low) * span_s
    )


def by_window(
    times_s: FloatArray,
    values: FloatArray,
    window_s: float,
    figure: Callable[[FloatArray], Any],
) -> tuple[FloatArray, FloatArray]:
    """Return the middles (w,) of the windows that hold at least three values, and a figure of each.

    Parameters
    ----------
    times_s, values
        Shape (n,), in any order.
    window_s
        Length of a window.
    figure
        Figure of the values of one window.
    """
    number = np.floor(times_s / window_s).astype(np.int64)
    middles, figures = [], []
    for window in np.unique(number):
        inside = values[number == window]
        if len(inside) >= 3:
            middles.append((float(window) + 0.5) * window_s)
            figures.append(figure(inside))
    return np.array(middles), np.array(figures)


def outside(times_s: FloatArray, intervals_s: list[tuple[float, float]]) -> BoolArray:
    """Return which times (n,) lie in none of the intervals."""
    free = np.ones(len(times_s), dtype=bool)
    for start_s, end_s in intervals_s:
        free &= (times_s < start_s) | (times_s > end_s)
    return free
