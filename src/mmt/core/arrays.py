"""Array types shared by every layer, and vectors as plain floats.

Code that runs once a tick is several times slower on NumPy scalars than on floats.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
"""Real-valued samples; the shape is given where it is used."""

SingleArray = npt.NDArray[np.float32]
"""Single-precision samples, as in frames; the shape is given where it is used."""

IntArray = npt.NDArray[np.int64]
"""Indices and sequence numbers."""

BoolArray = npt.NDArray[np.bool_]
"""Masks."""

RecordArray = npt.NDArray[Any]
"""A structured array, such as a block of frames."""

Vector = tuple[float, float, float]
"""x, y, z."""


def difference(first: Vector, second: Vector) -> Vector:
    """Return `first` minus `second`."""
    return (first[0] - second[0], first[1] - second[1], first[2] - second[2])


def clipped(position: Vector, low: Vector, high: Vector) -> Vector:
    """Return `position`, or the nearest point of the box from `low` to `high` if outside."""
    x, y, z = (max(a, min(p, b)) for p, a, b in zip(position, low, high, strict=True))
    return (x, y, z)


def step_towards(start: Vector, goal: Vector, most: float) -> Vector:
    """Return `goal`, or the point at distance `most` towards it if `goal` is farther away.

    Return `goal` if `start` is not finite; else `start` if `goal` is not finite. Large values
    do not overflow.
    """
    x, y, z = (0.25 * b - 0.25 * a for a, b in zip(start, goal, strict=True))
    quarter = math.hypot(x, y, z)
    if not quarter < math.inf:
        return start if all(map(math.isfinite, start)) else goal
    if quarter <= 0.25 * most:
        return goal
    share = most / quarter
    return (start[0] + share * x, start[1] + share * y, start[2] + share * z)


def bounded(vector: Vector, most: float) -> Vector:
    """Return a vector shortened to at most `most`, its direction kept; zero if not finite."""
    length = math.hypot(*vector)
    if length <= most:
        return vector
    if not length < math.inf:
        if not all(map(math.isfinite, vector)):
            return (0.0, 0.0, 0.0)
        return bounded((0.5 * vector[0], 0.5 * vector[1], 0.5 * vector[2]), most)
    share = most / length
    return (share * vector[0], share * vector[1], share * vector[2])
