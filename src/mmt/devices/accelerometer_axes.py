"""Mounting of an accelerometer: which sensor axis lies along which scene axis."""

from collections.abc import Sequence
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, model_validator

Axis = Literal["x", "-x", "y", "-y", "z", "-z"]


class AxesOptions(BaseModel):
    """How an accelerometer is mounted."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    axes: tuple[Axis, Axis, Axis] = ("x", "y", "z")
    """Sensor axes that lie along x, y, z of the scene; the scene's z is the surface's normal."""

    @model_validator(mode="after")
    def _axes_differ(self) -> Self:
        if {axis[-1] for axis in self.axes} != {"x", "y", "z"}:
            raise ValueError("axes must name each of x, y, z once, each with or without a minus")
        return self


def signed_axes(axes: Sequence[Axis]) -> list[tuple[int, float]]:
    """Return (index of the sensor axis, sign) for each of the scene's x, y and z."""
    return [("xyz".index(axis[-1]), -1.0 if axis[0] == "-" else 1.0) for axis in axes]
