"""Array types shared by every layer, and vectors as plain floats.

Code that runs once a tick is several times slower on NumPy scalars than on floats.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
"""Real-valued samples; the shape is given where it is used."""

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
    """Return `position` or, where it is outside the box of two corners, the nearest point in it."""
    x, y, z = (max(a, min(p, b)) for p, a, b in zip(position, low, high, strict=True))
    return (x, y, z)


def towards(start: Vector, goal: Vector, most: float) -> Vector:
    """Return `goal`, or the point at distance `most` towards it where it is farther away."""
    x, y, z = goal[0] - start[0], goal[1] - start[1], goal[2] - start[2]
    distance = math.sqrt(x * x + y * y + z * z)
    if distance <= most:
        return goal
    share = most / distance
    return (start[0] + share * x, start[1] + share * y, start[2] + share * z)
