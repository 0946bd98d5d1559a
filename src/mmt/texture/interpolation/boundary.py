"""Points around a model's samples, so that the interpolation covers all that a hand can reach.

In the plane of speed and force they lie on the four edges (paper A, section V.B); around the
cylinder of velocity vector and force on its faces and beside its wall.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray

HEADINGS: Final = 12
"""Points of a ring around the wall; each ring is turned by half a step against the last."""

LEVELS_OF_FORCE: Final = 4
"""Rings: at no force, one third, two thirds and all of the largest force."""

FACE_POINTS: Final = 16
"""Points inside either face, on a spiral that has no two of them at the same distance."""

RIM: Final = 1.0 / math.cos(math.pi / HEADINGS)
"""Radius of a ring: its polygon encloses the circle of the largest speed."""

_FACE_RADIUS: Final = 0.85
_GOLDEN_ANGLE: Final = math.pi * (3.0 - math.sqrt(5.0))


class Boundary(NamedTuple):
    """Points, shape (b, d), and whether the level there is zero, shape (b,)."""

    points: FloatArray
    silent: BoolArray


def boundary(dimensions: int) -> Boundary:
    """Return the boundary of the space of 2 or 3 inputs."""
    return _square() if dimensions == 2 else _cylinder()


def _square() -> Boundary:
    """Return 20 points: positions 0, 1/5 ... 1 of each edge, corners shared."""
    steps = np.arange(6) / 5
    edges = [(s, e) for s in steps for e in (0.0, 1.0)] + [
        (e, s) for s in steps[1:-1] for e in (0.0, 1.0)
    ]
    points = np.array(edges)
    return Boundary(points, (points == 0.0).any(axis=1))


def _cylinder() -> Boundary:
    """Return rings, and points inside the faces: 80, none of them silent.

    That nothing is felt at rest is the level table's (`mmt.texture.model.kernel_parameters`).
    """
    headings = np.linspace(0.0, 2.0 * np.pi, HEADINGS, endpoint=False)
    rings = [
        _at(RIM, headings + (number % 2) * np.pi / HEADINGS, number / (LEVELS_OF_FORCE - 1))
        for number in range(LEVELS_OF_FORCE)
    ]
    turn = np.arange(FACE_POINTS, dtype=np.float64)
    radius: FloatArray = _FACE_RADIUS * np.sqrt((turn + 0.5) / FACE_POINTS)
    faces = [_at(radius, turn * _GOLDEN_ANGLE, force) for force in (0.0, 1.0)]
    points = np.vstack([*rings, *faces])
    return Boundary(points, np.zeros(len(points), np.bool_))


def _at(radius: float | FloatArray, heading: FloatArray, force: float | FloatArray) -> FloatArray:
    columns = radius * np.cos(heading), radius * np.sin(heading), force
    return np.stack(np.broadcast_arrays(*columns), axis=-1)
