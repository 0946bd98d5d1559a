"""The options of the drivers, as a scene gives them."""

from math import hypot
from typing import Annotated, Final, Self

from pydantic import Field, model_validator

from mmt.core.arrays import Vector
from mmt.devices.axes import Axes, AxesOptions, AxesText, Millimetres

DEFAULT_AXES: Final = "x,-z,y"
"""The scene's x is HD's x; its y points away from the user; its z, the normal, points up."""

_DELAY_TICKS: Final = 1.5
"""Delay of the loop: half a tick, since a force holds for a tick, and one for the measurement."""


Newtons = Annotated[float, Field(gt=0, le=40)]


class HdOptions(AxesOptions):
    """Options that robot and handle share."""

    library: str = Field("libHD.so", min_length=1)
    device: str | None = Field(None, min_length=1, max_length=63)
    axes: AxesText = DEFAULT_AXES
    origin_mm: tuple[Millimetres, Millimetres, Millimetres] = (0.0, 0.0, 0.0)
    force_limit_n: Newtons | tuple[Newtons, Newtons, Newtons] = 3.0
    """Limit of the whole force, or one along each of the scene's axes."""
    stale_ms: float = Field(50.0, ge=5, le=1000)
    ramp_ms: float = Field(100.0, ge=5, le=2000)
    calibration_s: float = Field(5.0, ge=0, le=120)
    reset_encoders: bool = False

    @property
    def axes_limit_n(self) -> Vector | None:
        """Largest force along each of the device's axes, None if the whole force is limited."""
        limit_n = self.force_limit_n
        if not isinstance(limit_n, tuple):
            return None
        x, y, z = Axes(self.axes).to_device(limit_n)
        return (abs(x), abs(y), abs(z))

    @property
    def whole_limit_n(self) -> float:
        """Largest force in any direction that the limits allow."""
        limit_n = self.force_limit_n
        return hypot(*limit_n) if isinstance(limit_n, tuple) else limit_n


class HdRobotOptions(HdOptions):
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
