"""The options of the drivers, as a scene gives them."""

from typing import Annotated, Final, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from mmt.core.arrays import Vector

_Millimetres = Annotated[float, Field(ge=-3000, le=3000)]
_Radians = Annotated[float, Field(ge=-6.3, le=6.3)]
_Place = tuple[_Millimetres, _Millimetres, _Millimetres]
_BOX_MM: Final[Vector] = (300.0, 300.0, 100.0)


class UrOptions(BaseModel):
    """Options that robot and force sensor share."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    host: str = Field(min_length=1, max_length=253)
    frequency_hz: float = Field(500.0, ge=50, le=500)
    rotation_rad: tuple[_Radians, _Radians, _Radians] = (0.0, 0.0, 0.0)


class UrRobotOptions(UrOptions):
    """Options of the robot."""

    origin_mm: _Place | None = None
    least_mm: _Place = (-_BOX_MM[0], -_BOX_MM[1], -_BOX_MM[2])
    most_mm: _Place = _BOX_MM
    speed_limit_mm_s: float = Field(250.0, gt=0, le=1000)
    acceleration_limit_mm_s2: float = Field(5000.0, ge=100, le=50_000)
    force_limit_n: float = Field(30.0, gt=0, le=150)
    lookahead_s: float = Field(0.03, ge=0.03, le=0.2)
    gain: float = Field(300.0, ge=100, le=2000)

    @model_validator(mode="after")
    def _least_below_most(self) -> Self:
        for axis, least, most in zip("xyz", self.least_mm, self.most_mm, strict=True):
            if least >= most:
                raise ValueError(
                    f"least_mm has {least:g} along {axis}, most_mm has {most:g}: the first must be "
                    "the smaller"
                )
        return self


class ForceOptions(UrOptions):
    """Options of the force sensor."""

    stuck_ms: float = Field(1000.0, ge=0, le=60_000)
