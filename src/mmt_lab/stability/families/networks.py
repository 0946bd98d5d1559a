"""Radial basis networks: samples nearly coincident, on lines and planes, and removed ones.

The system's condition number grows without bound as samples approach each other. The network must
still pass through its samples, but for its smoothing, which is small.
"""

from collections.abc import Iterator
from functools import partial
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.interpolation.network_solving import RadialBasisNetwork
from mmt_lab.stability.families import CaseResult, Extreme, Family
from mmt_methods.selection.published import NetworkNeighbours

_THROUGH: Final = "through the samples to 1e-5; under 10 elsewhere"


def cases(*, samples: int = 60) -> list[Extreme]:
    """Return the family's cases; `samples` is how many each network has."""
    return [
        *(
            Extreme(f"{samples} samples, {what}", _THROUGH, partial(_through, points))
            for what, points in _difficult(samples)
        ),
        Extreme(
            f"half of {samples} samples leave",
            "the network solved so, to 1e-6",
            partial(_halved, samples),
        ),
    ]


def _difficult(count: int) -> Iterator[tuple[str, FloatArray]]:
    centres = np.repeat(_anywhere(count // 2), 2, axis=0)
    for apart in (1e-3, 1e-5, 2e-6):
        pairs = centres + apart * np.tile([[0.0], [1.0]], (count // 2, 3))
        yield f"in pairs {apart:g} apart", pairs
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


def _values(points: FloatArray) -> FloatArray:
    """Return a smooth function of points (n, 3): two outputs (n, 2) from -1 to 1."""
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


def _halved(count: int) -> CaseResult:
    """Remove every second sample; compare the closed form of predictions with solved networks."""
    points, present = _anywhere(count), np.ones(count, dtype=np.bool_)
    values = _values(points)
    neighbours = NetworkNeighbours(points, values, present)
    for index in range(0, count, 2):
        neighbours.remove(index)
        present[index] = False
    worst = 0.0
    for index in np.flatnonzero(present).tolist():
        others = present.copy()
        others[index] = False
        solved = RadialBasisNetwork(points[others], values[others]).at(points[index : index + 1])
        predicted = neighbours.predict(index)
        worst = np.inf if predicted is None else max(worst, np.abs(solved[0] - predicted).max())
    return CaseResult(f"off by {worst:.0e}", held=worst < 1e-6, figures={"off": float(worst)})


FAMILY: Final = Family("Radial basis networks", cases)
