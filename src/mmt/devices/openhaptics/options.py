"""The options of the drivers, as a scene gives them."""

import re
from collections.abc import Sequence
from typing import Annotated, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from mmt.devices.protocols import Vector

DEFAULT_AXES: Final = "x,-z,y"
"""The scene's x is HD's x, its y leads away from the user, its z, the normal, up."""

_TERM: Final = re.compile(r"\s*([+-]?)([xyz])\s*")


class Axes:
    """A rotation by quarter turns and an origin.

    Parameters
    ----------
    text
        The device's axes that are the scene's x, y and z, such as ``x,-z,y``.
    origin_mm
        The point, in the scene's axes, where the scene's zero lies.

    Raises
    ------
    ValueError
        The text does not name each axis once, or mirrors.
    """

    def __init__(self, text: str, origin_mm: Vector = (0.0, 0.0, 0.0)) -> None:
        terms = [_TERM.fullmatch(part) for part in text.split(",")]
        names = [term[2] for term in terms if term is not None]
        if len(terms) != 3 or sorted(names) != ["x", "y", "z"]:
            raise ValueError(f"axes are {text!r}: name x, y and z once each, as in {DEFAULT_AXES}")
        self._from = tuple("xyz".index(name) for name in names)
        self._to = tuple(names.index(name) for name in "xyz")
        self._signs = tuple(-1.0 if term is not None and term[1] == "-" else 1.0 for term in terms)
        a, b, c = self._from
        parity = (b - a) * (c - a) * (c - b) / 2.0
        if parity * self._signs[0] * self._signs[1] * self._signs[2] < 0.0:
            raise ValueError(f"axes are {text!r}, which mirrors: turn the sign of one of them")
        self._origin = origin_mm

    def to_scene(self, values: Sequence[float]) -> Vector:
        """Turn a velocity or a force of the device into the scene's axes."""
        (a, b, c), (p, q, r) = self._from, self._signs
        return (p * values[a], q * values[b], r * values[c])

    def to_device(self, vector: Vector) -> Vector:
        """Turn a velocity or a force of the scene into the device's axes."""
        (a, b, c), signs = self._to, self._signs
        return (signs[a] * vector[a], signs[b] * vector[b], signs[c] * vector[c])

    def place_in_scene(self, values: Sequence[float]) -> Vector:
        """Turn a position of the device (mm) into one of the scene."""
        (x, y, z), (u, v, w) = self.to_scene(values), self._origin
        return (x - u, y - v, z - w)

    def place_on_device(self, position_mm: Vector) -> Vector:
        """Turn a position of the scene (mm) into one of the device."""
        (x, y, z), (u, v, w) = position_mm, self._origin
        return self.to_device((x + u, y + v, z + w))


_Millimetres = Annotated[float, Field(ge=-1000, le=1000)]

_DELAY_TICKS: Final = 1.5
"""A force that holds for a tick is half a tick late; the measurement costs another one."""


class HdOptions(BaseModel):
    """What robot and handle share."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    library: str = Field("libHD.so", min_length=1)
    device: str | None = Field(None, min_length=1, max_length=63)
    axes: str = DEFAULT_AXES
    origin_mm: tuple[_Millimetres, _Millimetres, _Millimetres] = (0.0, 0.0, 0.0)
    force_limit_n: float = Field(3.0, gt=0, le=40)
    stale_ms: float = Field(50.0, ge=5, le=1000)
    ramp_ms: float = Field(100.0, ge=5, le=2000)
    calibration_s: float = Field(5.0, ge=0, le=120)
    reset_encoders: bool = False

    @model_validator(mode="after")
    def _right_axes(self) -> Self:
        Axes(self.axes)
        return self


class RobotOptions(HdOptions):
    """Options of the robot: the position controller."""

    stiffness_n_mm: float = Field(0.5, gt=0, le=5)
    damping_n_s_m: float = Field(5.0, ge=0, le=30)
    speed_limit_mm_s: float = Field(500.0, gt=0, le=2000)

    @model_validator(mode="after")
    def _damped(self) -> Self:
        least = _DELAY_TICKS * self.stiffness_n_mm  # N/mm times 1 ms is N s/m
        if self.damping_n_s_m < least:
            raise ValueError(
                f"damping_n_s_m is {self.damping_n_s_m:g}; a stiffness of "
                f"{self.stiffness_n_mm:g} N/mm oscillates at 1 kHz below {least:g}: raise it, "
                "or be less stiff"
            )
        return self


class HandleOptions(HdOptions):
    """Options of the handle: how the hand's normal force is known."""

    hand_force: Literal["displayed", "depth"] = "displayed"
    apparent_mass_kg: float = Field(0.0, ge=0, le=1)
    depth_stiffness_n_mm: float = Field(0.5, gt=0, le=50)
    contact_n: float = Field(0.05, ge=0.001, le=1)
