"""Places and forces as plain floats; per-tick code is several times slower on NumPy scalars."""

import math

Vector = tuple[float, float, float]
"""x, y, z."""


def difference(first: Vector, second: Vector) -> Vector:
    """Return the first less the second."""
    return (first[0] - second[0], first[1] - second[1], first[2] - second[2])


def towards(start: Vector, goal: Vector, most: float) -> Vector:
    """Return the goal where it is no farther than `most`, else the point so far towards it."""
    x, y, z = goal[0] - start[0], goal[1] - start[1], goal[2] - start[2]
    distance = math.sqrt(x * x + y * y + z * z)
    if distance <= most:
        return goal
    share = most / distance
    return (start[0] + share * x, start[1] + share * y, start[2] + share * z)
