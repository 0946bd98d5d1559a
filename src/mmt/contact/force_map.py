"""Remember the force that was met at a place and a speed.

A model of a surface has few parameters, and what they do not explain comes back at every
stroke: the width of a foam's hysteresis, the shape of a knock, the drag of the tool. The memory
holds the mean force over a grid of depth and speed, interpolated bilinearly, and how far it is
to be believed, which grows with the samples near there. Newer samples replace older ones. It
is the look-up table of locally weighted learning (Atkeson, Moore and Schaal, "Locally weighted
learning", Artificial Intelligence Review 11 (1997)) in its cheapest form: it says nothing of
places where the tool has not been, for which there is the model.

A force that depends on the speed without bound on its slope can keep a loop moving. Slow motion
is therefore left to the model: the memory's weight falls with the square of the speed.

Cost: about 5 us a sample, and 4 us a look-up, in plain Python.
"""

import math
from typing import Final

_CELL_M: Final = 0.25e-3
_CELL_M_S: Final = 0.025
_FASTEST: Final = 40
"""Cells of speed to either side; what is faster counts as this."""
_FARTHEST_M: Final = 1e3
_MOST_CELLS: Final = 20_000
_DOUBTED: Final = 1.0
"""Samples that make a cell half believed."""
_MOST_SAMPLES: Final = 8.0
"""A cell's mean is over about so many of its newest samples."""
_SLOW_M_S: Final = 0.02
"""Speed at which the memory counts half."""
_FILTER_S: Final = 0.01

Cell = tuple[int, int]


class SmoothSpeed:
    """The speed of a place, behind a first-order filter of 10 ms."""

    def __init__(self) -> None:
        self._smooth_m: float | None = None

    def step(self, place_m: float, period_s: float) -> float:
        """Return the speed (m/s) at a place (m), `period_s` after the last one.

        It is 0 at the first, and at one that is not finite, which is left out.
        """
        if not math.isfinite(place_m):
            return 0.0
        before_m = place_m if self._smooth_m is None else self._smooth_m
        keep = math.exp(-period_s / _FILTER_S)
        self._smooth_m = place_m + keep * (before_m - place_m)
        return keep * (place_m - before_m) / _FILTER_S


class ForceMap:
    """Mean force over depth and speed."""

    def __init__(self) -> None:
        self._cells: dict[Cell, tuple[float, float]] = {}

    def add(self, depth_m: float, speed_m_s: float, force_n: float) -> None:
        """Take a sample; one that is not finite or out of all reach is left out."""
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
        """Return the force (N) met there and its weight, from 0 (unknown) to 1."""
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
