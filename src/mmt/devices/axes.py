"""Axes and origin of a device, and axes of an accelerometer, against those of a scene."""

import re
from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from mmt.core.arrays import Vector
from mmt.core.quaternions import UNIT_VECTORS, Quaternion, product, quaternion_of_axes

Millimetres = Annotated[float, Field(ge=-1000, le=1000)]
"""One coordinate of an origin, as an option."""

_TERM: Final = re.compile(r"\s*([+-]?)([xyz])\s*")


class Axes:
    """A rotation by quarter turns and an origin.

    Parameters
    ----------
    text
        Device axes along the scene's x, y and z, such as ``x,-z,y``.
    origin_mm
        Scene's zero seen from the device's zero, in the scene's axes.

    Raises
    ------
    ValueError
        The text does not name each axis once, or the axes mirror.
    """

    def __init__(self, text: str, origin_mm: Vector = (0.0, 0.0, 0.0)) -> None:
        terms = [_TERM.fullmatch(part) for part in text.split(",")]
        names = [term[2] for term in terms if term is not None]
        if len(terms) != 3 or sorted(names) != ["x", "y", "z"]:
            raise ValueError(f"axes are {text!r}: name x, y and z once each, as in x,-z,y")
        self._from = tuple("xyz".index(name) for name in names)
        self._to = tuple(names.index(name) for name in "xyz")
        self._signs = tuple(-1.0 if term is not None and term[1] == "-" else 1.0 for term in terms)
        a, b, c = self._from
        parity = (b - a) * (c - a) * (c - b) / 2.0
        if parity * self._signs[0] * self._signs[1] * self._signs[2] < 0.0:
            raise ValueError(f"axes are {text!r}, which mirrors: turn the sign of one of them")
        self._origin = origin_mm
        self._turn = quaternion_of_axes(*map(self.to_scene, UNIT_VECTORS))

    def to_scene(self, values: Sequence[float]) -> Vector:
        """Turn a velocity or a force of the device into the scene's axes."""
        (a, b, c), (p, q, r) = self._from, self._signs
        return (p * values[a], q * values[b], r * values[c])

    def to_device(self, vector: Vector) -> Vector:
        """Turn a velocity or a force of the scene into the device's axes."""
        (a, b, c), signs = self._to, self._signs
        return (signs[a] * vector[a], signs[b] * vector[b], signs[c] * vector[c])

    def turn_in_scene(self, orientation: Quaternion) -> Quaternion:
        """Return an orientation in the scene's axes, from one in the device's."""
        return product(self._turn, orientation)

    def place_in_scene(self, values: Sequence[float]) -> Vector:
        """Turn a position of the device (mm) into one of the scene."""
        (x, y, z), (u, v, w) = self.to_scene(values), self._origin
        return (x - u, y - v, z - w)

    def place_on_device(self, position_mm: Vector) -> Vector:
        """Turn a position of the scene (mm) into one of the device."""
        (x, y, z), (u, v, w) = position_mm, self._origin
        return self.to_device((x + u, y + v, z + w))


def _as_text(axes: Any) -> Any:
    """Return axes that are listed, as an accelerometer's are, as one text."""
    return ",".join(map(str, axes)) if isinstance(axes, list | tuple) else axes


def _as_list(axes: Any) -> Any:
    """Return axes in one text, as a robot's are, as a list."""
    return [part.strip() for part in axes.split(",")] if isinstance(axes, str) else axes


AxesText = Annotated[str, BeforeValidator(_as_text)]
"""Axes as `Axes` takes them."""


class AxesOptions(BaseModel):
    """Options of a device with axes of its own."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    axes: AxesText = "x,y,z"
    """Device axes along the scene's, see `Axes`."""

    @model_validator(mode="after")
    def _right_axes(self) -> Self:
        Axes(self.axes)
        return self


Axis = Literal["x", "-x", "y", "-y", "z", "-z"]


class SensorAxesOptions(BaseModel):
    """How an accelerometer is mounted."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    axes: Annotated[tuple[Axis, Axis, Axis], BeforeValidator(_as_list)] = ("x", "y", "z")
    """Sensor axes that lie along x, y, z of the scene; the scene's z is the surface's normal."""

    @model_validator(mode="after")
    def _axes_differ(self) -> Self:
        if {axis[-1] for axis in self.axes} != {"x", "y", "z"}:
            raise ValueError("axes must name each of x, y, z once, each with or without a minus")
        return self


def signed_axes(axes: Sequence[Axis]) -> list[tuple[int, float]]:
    """Return (index of the sensor axis, sign) for each of the scene's x, y and z."""
    return [("xyz".index(axis[-1]), -1.0 if axis[0] == "-" else 1.0) for axis in axes]
