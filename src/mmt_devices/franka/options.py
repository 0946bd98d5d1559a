"""The options of the drivers, as a scene gives them."""

from typing import Literal, Self

from pydantic import Field, model_validator

from mmt.devices.axes import AxesOptions, Millimetres


class ArmOptions(AxesOptions):
    """Options that robot and force sensor share: the connection, and the axes."""

    host: str = Field(min_length=1, max_length=253)
    realtime: Literal["enforce", "ignore"] = "enforce"


class FrankaRobotOptions(ArmOptions):
    """Options of the robot: position controller, limits and thresholds of a collision."""

    origin_mm: tuple[Millimetres, Millimetres, Millimetres] = (0.0, 0.0, 0.0)
    stiffness_n_mm: float = Field(1.0, ge=0.05, le=3)
    rotational_stiffness_nm_rad: float = Field(50.0, ge=1, le=300)
    posture_stiffness_nm_rad: float = Field(10.0, ge=0, le=50)
    force_limit_n: float = Field(20.0, gt=0, le=60)
    speed_limit_mm_s: float = Field(250.0, gt=0, le=1000)
    collision_force_n: float = Field(30.0, ge=5, le=100)
    collision_torque_nm: float = Field(20.0, ge=5, le=100)

    @model_validator(mode="after")
    def _pushes_less_than_a_collision(self) -> Self:
        if self.force_limit_n >= self.collision_force_n:
            raise ValueError(
                f"force_limit_n is {self.force_limit_n:g}; the arm takes a force of "
                f"collision_force_n, {self.collision_force_n:g}, for a collision: lower the "
                "first, or raise the second"
            )
        return self
