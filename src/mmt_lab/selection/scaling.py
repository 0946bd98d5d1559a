"""How the cost of a selection grows: every point left out once, by its star and by rebuilding."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import Delaunay

from mmt.core.arrays import FloatArray, IntArray
from mmt.testing.simulation.textures import SURFACES
from mmt.texture.selection import select
from mmt.texture.selection.leave_one_out import leave_each_out
from mmt_lab.selection.trials import simulate_trials

SIZES: Final = (100, 200, 461, 1000, 2000)
_REBUILT: Final = 12  # triangulations that stand for all


@dataclass(frozen=True)
class Scaling:
    """Seconds for n points: every one left out by its star, by rebuilding, and the selection.

    ``same`` counts the simplices that both ways agree on, of ``compared``.
    """

    dimensions: int
    points: int
    star_s: float
    rebuilt_s: float
    select_s: float
    same: int
    compared: int


def measure_scaling(sizes: Sequence[int] = SIZES) -> list[Scaling]:
    """Measure both ways for each size in two and three dimensions."""
    return [_measure(d, n) for d in (2, 3) for n in sizes]


def _measure(dimensions: int, count: int) -> Scaling:
    generator = np.random.default_rng([dimensions, count])
    surface = SURFACES["plastic" if dimensions == 2 else "oak"]
    data = simulate_trials(surface, count, count // 10, generator, directed=dimensions == 3).data
    started = time.perf_counter()
    members, _, _ = leave_each_out(data.points)
    star_s = time.perf_counter() - started
    chosen = generator.choice(count, _REBUILT, replace=False)
    started = time.perf_counter()
    rebuilt = [_rebuilt(data.points, index) for index in chosen.tolist()]
    rebuilt_s = (time.perf_counter() - started) * count / _REBUILT
    started = time.perf_counter()
    select(data)
    select_s = time.perf_counter() - started
    same = sum(_agree(a, b) for a, b in zip(members[chosen], rebuilt, strict=True))
    return Scaling(dimensions, count, star_s, rebuilt_s, select_s, same, _REBUILT)


def _rebuilt(points: FloatArray, index: int) -> IntArray | None:
    others = np.delete(np.arange(len(points)), index)
    triangulation = Delaunay(points[others])
    found = int(triangulation.find_simplex(points[index]))
    return None if found < 0 else others[triangulation.simplices[found]]


def _agree(members: IntArray, rebuilt: IntArray | None) -> bool:
    if rebuilt is None:
        return bool(members[0] < 0)
    return set(members.tolist()) == set(rebuilt.tolist())
