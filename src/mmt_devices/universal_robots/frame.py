"""Conversion between the scene's frame and that of the arm's base."""

from collections.abc import Sequence
from typing import Final

from mmt.core.quaternions import Quaternion, Vector, product, quaternion_of_vector

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
        w, x, y, z = self._into_base = quaternion_of_vector(rotation_rad)
        self._into_scene = (w, -x, -y, -z)

    def to_scene(self, vector: Sequence[float]) -> Vector:
        """Rotate a force from the base's axes into the scene's."""
        return _turned(self._into_scene, vector)

    def to_base(self, vector: Sequence[float]) -> Vector:
        """Rotate a vector from the scene's axes into the base's."""
        return _turned(self._into_base, vector)

    def turn_in_scene(self, rotation_rad: Vector) -> Quaternion:
        """Return the orientation of a rotation vector of the base, in the scene's axes."""
        return product(self._into_scene, quaternion_of_vector(rotation_rad))

    def place_in_scene(self, position_m: Sequence[float]) -> Vector:
        """Convert a position from the base (m) to the scene (mm)."""
        (u, v, w), (x, y, z) = self._origin_mm, position_m[:3]
        return self.to_scene((M_TO_MM * x - u, M_TO_MM * y - v, M_TO_MM * z - w))

    def place_in_base(self, position_mm: Vector) -> Vector:
        """Convert a position from the scene (mm) to the base (m)."""
        (u, v, w), (x, y, z) = self._origin_mm, self.to_base(position_mm)
        return ((x + u) / M_TO_MM, (y + v) / M_TO_MM, (z + w) / M_TO_MM)


def _turned(turn: Quaternion, vector: Sequence[float]) -> Vector:
    (w, x, y, z), (a, b, c) = turn, vector[:3]
    _, u, v, t = product(product(turn, (0.0, a, b, c)), (w, -x, -y, -z))
    return (u, v, t)
