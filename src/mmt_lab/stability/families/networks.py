"""Radial basis networks: samples all but coincident, on lines and planes, invalid filters.

The system's condition grows without bound as samples approach each other. What a network may then
not do is leave its samples without need: it is off by its smoothing, which is small.
"""

from collections.abc import Iterator
from functools import partial
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.texture.autoregression.forms import lsf_to_reflection
from mmt.texture.interpolation.networks.evaluation import nearest_valid_lsf
from mmt.texture.interpolation.networks.solving import RadialBasisNetwork
from mmt_lab.stability.cases import CaseResult, Extreme, Family
from mmt_methods.selection.networks import NetworkNeighbours

_LEFT_OUT: Final = "the network solved so, to 1e-6"
_THROUGH: Final = "through the samples to 1e-5; under 10 elsewhere"


def cases(*, samples: int = 60) -> list[Extreme]:
    """Return the family's cases; `samples` is how many each network has."""
    return [
        *(
            Extreme(f"{samples} samples, {what}", _THROUGH, partial(_through, points))
            for what, points in _difficult(samples)
        ),
        Extreme(f"without each of {samples} samples", _LEFT_OUT, partial(_left_out, samples)),
        Extreme(f"half of {samples} samples leave", _LEFT_OUT, partial(_halved, samples)),
        *(
            Extreme(
                f"2000 sets of frequencies of order {order}, off by {noise:g} rad",
                "ascending by the least gap, within bounds, |k| < 1",
                partial(_made_valid, order, noise),
            )
            for order, noise in ((1, 10.0), (8, 0.1), (24, 1.0), (64, 1e6))
        ),
    ]


def _difficult(count: int) -> Iterator[tuple[str, FloatArray]]:
    for apart in (1e-3, 1e-5, 2e-6):
        yield f"in pairs {apart:g} apart", _pairs(count, apart)
    yield "on a line", np.outer(np.linspace(0.05, 0.95, count), (0.6, -0.5, 1.0))
    plane = _anywhere(count)
    plane[:, 2] = 0.5
    yield "on a plane", plane
    yield "within 1e-4 of each other", 0.4 + 1e-4 * _anywhere(count)
    for few in (1, 2, 3, 4):
        yield f"{few} of them", _anywhere(few)


def _anywhere(count: int) -> FloatArray:
    generator = np.random.default_rng(count)
    turn, speed = generator.uniform(0.0, 7.0, count), np.sqrt(generator.uniform(0.0, 1.0, count))
    return np.column_stack([speed * np.cos(turn), speed * np.sin(turn), generator.random(count)])


def _pairs(count: int, apart: float) -> FloatArray:
    centres = _anywhere(count // 2)
    return np.repeat(centres, 2, axis=0) + apart * np.tile([[0.0], [1.0]], (len(centres), 3))


def _values(points: FloatArray) -> FloatArray:
    """Return a smooth function of points (n, 3), as two outputs (n, 2) within one."""
    one = np.sin(3.0 * points[:, 0]) * np.cos(2.0 * points[:, 1]) * points[:, 2]
    return np.column_stack([one, np.cos(points @ (1.0, -2.0, 1.5))])


def _through(points: FloatArray) -> CaseResult:
    values = _values(points)
    network = RadialBasisNetwork(points, values)
    off = float(np.abs(values - network.at(points)).max())
    largest = float(np.abs(network.at(_anywhere(500))).max())
    return CaseResult(
        f"off by {off:.0e}, to {largest:.1f} elsewhere",
        held=off < 1e-5 and largest < 10.0,
        figures={"off": off},
    )


def _left_out(count: int) -> CaseResult:
    """Compare the closed form of the errors with networks that are solved without a sample."""
    points = _anywhere(count)
    values = _values(points)
    neighbours = NetworkNeighbours(points, values, np.ones(count, dtype=np.bool_))
    return _compared(points, values, neighbours, np.ones(count, dtype=np.bool_))


def _halved(count: int) -> CaseResult:
    """Let every second sample leave, and compare likewise."""
    points, present = _anywhere(count), np.ones(count, dtype=np.bool_)
    values = _values(points)
    neighbours = NetworkNeighbours(points, values, present)
    for index in range(0, count, 2):
        neighbours.remove(index)
        present[index] = False
    return _compared(points, values, neighbours, present)


def _compared(
    points: FloatArray, values: FloatArray, neighbours: NetworkNeighbours, present: BoolArray
) -> CaseResult:
    worst = 0.0
    for index in np.flatnonzero(present).tolist():
        others = present.copy()
        others[index] = False
        solved = RadialBasisNetwork(points[others], values[others]).at(points[index : index + 1])
        predicted = neighbours.predict(index)
        worst = np.inf if predicted is None else max(worst, np.abs(solved[0] - predicted).max())
    return CaseResult(f"off by {worst:.0e}", held=worst < 1e-6, figures={"off": float(worst)})


def _made_valid(order: int, noise: float) -> CaseResult:
    """Spoil frequencies as an overshooting network does, by more and more, some to no number."""
    generator = np.random.default_rng(order)
    gap, least, largest_k = min(0.03, 0.5 * np.pi / (order + 1)), np.inf, 0.0
    lowest: FloatArray = gap * np.arange(1.0, order + 1)
    highest: FloatArray = np.ascontiguousarray(np.pi - lowest[::-1])
    within = True
    for _ in range(2000):
        lsf = np.sort(generator.uniform(0.0, np.pi, order)) + noise * generator.normal(size=order)
        lsf[generator.random(order) < 0.02] = generator.choice([np.nan, np.inf, -np.inf])
        nearest_valid_lsf(lsf, gap, lowest, highest, np.empty(3 * order))
        least = min(least, float(np.diff(lsf, prepend=0.0, append=np.pi).min()))
        within &= bool((lsf >= lowest - 1e-9).all() and (lsf <= highest + 1e-9).all())
        largest_k = max(largest_k, float(np.abs(lsf_to_reflection(lsf)).max()))
    return CaseResult(
        f"gaps from {least:.3g} rad of {gap:.3g}, |k| to 1 - {1.0 - largest_k:.0e}, "
        f"{'within' if within else 'beyond'} bounds",
        held=least >= gap * (1.0 - 1e-9) and largest_k < 1.0 and within,
        figures={"least_gap_rad": least, "largest_k": largest_k},
    )


FAMILY: Final = Family("Radial basis networks", cases)
