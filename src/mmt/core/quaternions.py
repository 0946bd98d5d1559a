"""Unit quaternions (w, x, y, z), by which vectors are turned from a tool's axes into a scene's.

The quaternions q and -q are the same orientation. Nothing here needs NumPy: drivers' processes
import it.
"""

import math
from collections.abc import Sequence
from typing import Final, TypeAlias

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]

LARGEST_OFF: Final = 0.01
"""Largest deviation of a quaternion's norm from 1."""


UNIT_VECTORS: Final[tuple[Vector, Vector, Vector]] = (
    (1.0, 0.0, 0.0),
    (0.0, 1.0, 0.0),
    (0.0, 0.0, 1.0),
)


def unit_quaternion(values: Sequence[float]) -> Quaternion | None:
    """Return a quaternion with the norm 1; None if it is off by more than `LARGEST_OFF`."""
    w, x, y, z = values
    norm = math.hypot(w, x, y, z)
    if not abs(norm - 1.0) <= LARGEST_OFF:  # also if it is not finite
        return None
    return (w / norm, x / norm, y / norm, z / norm)


def quaternion_of_axes(x_axis: Vector, y_axis: Vector, z_axis: Vector) -> Quaternion:
    """Return the quaternion of a rotation, from what the unit vectors x, y and z are turned into.

    Its norm is not 1 if these are no right-handed axes of length 1. The largest component is found
    first (Shepperd, J. Guidance and Control 1 (1978), 223-224).
    """
    (a, b, c), (d, e, f), (g, h, i) = x_axis, y_axis, z_axis
    rows = (
        (1.0 + a + e + i, f - h, g - c, b - d),
        (f - h, 1.0 + a - e - i, b + d, g + c),
        (g - c, b + d, 1.0 - a + e - i, f + h),
        (b - d, g + c, f + h, 1.0 - a - e + i),
    )  # row k is the quaternion times four of its component k
    largest, place = max((row[place], place) for place, row in enumerate(rows))
    w, x, y, z = (each * 0.5 / math.sqrt(largest) for each in rows[place])
    return (w, x, y, z)


def product(second: Quaternion, first: Quaternion) -> Quaternion:
    """Return the quaternion that turns as `first` and then as `second`."""
    (a, b, c, d), (w, x, y, z) = second, first
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def quaternion_of_vector(rotation_rad: Sequence[float]) -> Quaternion:
    """Return the quaternion of a rotation vector: the axis times the angle."""
    x, y, z = rotation_rad
    angle = math.hypot(x, y, z)
    if not math.isfinite(angle):
        return (math.nan, math.nan, math.nan, math.nan)
    share = math.sin(0.5 * angle) / angle if angle else 0.5
    return (math.cos(0.5 * angle), share * x, share * y, share * z)
