"""Conversion between the scene's frame and that of the arm's base."""

import math
from collections.abc import Sequence
from typing import Final

from mmt.core.quaternions import (
    UNIT_VECTORS,
    Quaternion,
    Vector,
    product,
    quaternion_of_axes,
    quaternion_of_vector,
)

M_TO_MM: Final = 1000.0


class SceneFrame:
    """Rigid transformation from the base of the arm, in m, to the scene, in mm.

    Parameters
    ----------
    origin_mm
        The scene's zero in the frame of the base.
    rotation_rad
        The scene's axes in the frame of the base as a rotation vector: its direction is the axis,
        its length the angle. The pendant shows planes and points of a program in this form.
    """

    def __init__(self, origin_mm: Vector, rotation_rad: Vector) -> None:
        self._origin_mm = origin_mm
        self._rows = rotation_matrix(rotation_rad)
        self._columns = tuple(zip(*self._rows, strict=True))
        self._turn = quaternion_of_axes(*map(self.to_scene, UNIT_VECTORS))

    def to_scene(self, vector: Sequence[float]) -> Vector:
        """Rotate a force from the base's axes into the scene's."""
        return _product(self._columns, vector)

    def to_base(self, vector: Sequence[float]) -> Vector:
        """Rotate a vector from the scene's axes into the base's."""
        return _product(self._rows, vector)

    def turn_in_scene(self, rotation_rad: Vector) -> Quaternion:
        """Return the orientation of a rotation vector of the base, in the scene's axes."""
        return product(self._turn, quaternion_of_vector(rotation_rad))

    def place_in_scene(self, position_m: Sequence[float]) -> Vector:
        """Convert a position from the base (m) to the scene (mm)."""
        (u, v, w), (x, y, z) = self._origin_mm, position_m[:3]
        return self.to_scene((M_TO_MM * x - u, M_TO_MM * y - v, M_TO_MM * z - w))

    def place_in_base(self, position_mm: Vector) -> Vector:
        """Convert a position from the scene (mm) to the base (m)."""
        (u, v, w), (x, y, z) = self._origin_mm, self.to_base(position_mm)
        return ((x + u) / M_TO_MM, (y + v) / M_TO_MM, (z + w) / M_TO_MM)


def rotation_matrix(rotation_rad: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the rows of the matrix of a rotation vector (Rodrigues' formula)."""
    angle = math.hypot(*rotation_rad)
    if angle == 0.0:
        return ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    x, y, z = (part / angle for part in rotation_rad)
    c, s = math.cos(angle), math.sin(angle)
    t = 2.0 * math.sin(0.5 * angle) ** 2  # 1 - c, exact for small angles
    return (
        (c + t * x * x, t * x * y - s * z, t * x * z + s * y),
        (t * x * y + s * z, c + t * y * y, t * y * z - s * x),
        (t * x * z - s * y, t * y * z + s * x, c + t * z * z),
    )


def _product(rows: Sequence[Sequence[float]], vector: Sequence[float]) -> Vector:
    (a, b, c), (d, e, f), (g, h, i) = rows
    x, y, z = vector[:3]
    return (a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z)
