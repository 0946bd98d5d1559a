"""Map of the force met at a depth and a speed, to correct a parametric contact model.

A model of a surface has few parameters, and its residuals repeat at every stroke: the width of a
foam's hysteresis, the shape of a knock, the drag of the tool. The map holds the mean force over a
grid of depth and speed, interpolated bilinearly, and a confidence that grows with the number of
samples nearby. Newer samples replace older ones. It is the look-up table of locally weighted
learning (Atkeson, Moore and Schaal, "Locally weighted learning", Artificial Intelligence Review 11
(1997)) in its cheapest form; where the tool has not been, only the model is used.

A force whose slope over speed is unbounded can sustain motion in a closed loop. Slow motion is
therefore left to the model: the weight of the map falls with the square of the speed.

Cost: about 5 us a sample, and 4 us a look-up, in plain Python.
"""

import math
from typing import Final

_CELL_M: Final = 0.25e-3
_CELL_M_S: Final = 0.025
_FASTEST: Final = 40
"""Number of cells of speed to either side; faster motion counts as the fastest."""
_FARTHEST_M: Final = 1e3
_MOST_CELLS: Final = 20_000
_DOUBTED: Final = 1.0
"""Number of samples at which the confidence of a cell is one half."""
_MOST_SAMPLES: Final = 8.0
"""Number of newest samples over which the mean of a cell extends, approximately."""
_SLOW_M_S: Final = 0.02
"""Speed at which the weight of the map is halved."""
_FILTER_S: Final = 0.01

Cell = tuple[int, int]


class SmoothSpeed:
    """Speed of a position, behind a first-order filter, of 10 ms by default."""

    def __init__(self, filter_s: float = _FILTER_S) -> None:
        self._filter_s = filter_s
        self._smooth_m: float | None = None

    def step(self, place_m: float, period_s: float) -> float:
        """Return the speed (m/s) at a position (m), `period_s` after the last one.

        It is 0 for the first position, and for one that is not finite, which is ignored.
        """
        if not math.isfinite(place_m):
            return 0.0
        before_m = place_m if self._smooth_m is None else self._smooth_m
        moved_m = -math.expm1(-period_s / self._filter_s) * (place_m - before_m)
        self._smooth_m = before_m + moved_m
        return moved_m / period_s


class ForceMap:
    """Mean force over depth and speed."""

    def __init__(self) -> None:
        self._cells: dict[Cell, tuple[float, float]] = {}

    def add(self, depth_m: float, speed_m_s: float, force_n: float) -> None:
        """Add a sample; one that is not finite or beyond a plausible depth is ignored."""
        if not math.isfinite(force_n + speed_m_s) or not abs(depth_m) < _FARTHEST_M:
            return
        for cell, share in _corners(depth_m, speed_m_s):
            count, mean_n = self._cells.get(cell, (0.0, 0.0))
            count = min(count + share, _MOST_SAMPLES)
            if share > 0.0:
                self._cells[cell] = (count, mean_n + share / count * (force_n - mean_n))
        while len(self._cells) > _MOST_CELLS:
            del self._cells[next(iter(self._cells))]

    def look_up(self, depth_m: float, speed_m_s: float) -> tuple[float, float]:
        """Return the mean force (N) at a depth and speed, and its weight from 0 (unknown) to 1."""
        if not math.isfinite(speed_m_s) or not abs(depth_m) < _FARTHEST_M:
            return 0.0, 0.0
        weight = total_n = 0.0
        for cell, share in _corners(depth_m, speed_m_s):
            count, mean_n = self._cells.get(cell, (0.0, 0.0))
            believed = share * count / (count + _DOUBTED)
            weight += believed
            total_n += believed * mean_n
        if weight <= 0.0 or speed_m_s == 0.0:
            return 0.0, 0.0
        slowness = _SLOW_M_S / speed_m_s
        return total_n / weight, weight / (1.0 + slowness * slowness)


def _corners(depth_m: float, speed_m_s: float) -> tuple[tuple[Cell, float], ...]:
    """Return the four cells about a point, and the share of each."""
    across = depth_m / _CELL_M
    along = max(-_FASTEST, min(speed_m_s / _CELL_M_S, _FASTEST))
    i, j = math.floor(across), math.floor(along)
    p, q = across - i, along - j
    return (
        ((i, j), (1.0 - p) * (1.0 - q)),
        ((i + 1, j), p * (1.0 - q)),
        ((i, j + 1), (1.0 - p) * q),
        ((i + 1, j + 1), p * q),
    )
