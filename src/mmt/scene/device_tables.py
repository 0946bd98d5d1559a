"""Tables of a scene that name drivers."""

from typing import Annotated, Any, ClassVar, Final, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from mmt.scene.motion_limits import MotionLimits
from mmt.scene.table import PartTable, Service, Table

DRIVER_PATTERN: Final = r"^([\w-]+|[\w.]+:\w+)$"
"""A driver's name, as in ``ati-net-ft``, or ``package.module:factory``."""


class Driver(Table):
    """A driver and its options, which the driver validates; a string is short for the driver."""

    model_config = ConfigDict(extra="allow")

    driver: str = Field(pattern=DRIVER_PATTERN)

    @model_validator(mode="before")
    @classmethod
    def _short(cls, given: Any) -> Any:
        return {"driver": given} if isinstance(given, str) else given

    @property
    def options(self) -> dict[str, Any]:
        """The keys other than ``driver``, unvalidated."""
        return dict(self.model_extra or {})


class Handle(Driver, PartTable):
    """``[handle]``: the operator holds a real handle."""

    model_config = ConfigDict(extra="allow")

    on_lost: Literal["hold", "stop"] = "hold"
    hand_force: Literal["contact", "measured"] = "contact"
    surface_stiffness_n_mm: float = Field(0.5, gt=0, le=50)


class Actuator(PartTable):
    """``[actuator]``: the device that plays the vibration; without a driver a simulated one."""

    model_config = ConfigDict(extra="allow")

    driver: str | None = Field(None, pattern=DRIVER_PATTERN)
    limit_m_s2: float = Field(60.0, gt=0, le=1000)
    slew_m_s3: Annotated[float, Field(gt=0, le=1e8)] | Literal["off"] = 60_000.0

    @property
    def options(self) -> dict[str, Any]:
        """Keys that the driver defines."""
        return dict(self.model_extra or {})

    @model_validator(mode="after")
    def _of_the_driver(self) -> Self:
        if self.driver is None and self.model_extra:
            raise ValueError(
                f"{', '.join(self.model_extra)} is not a key without a driver, which may take it; "
                f"allowed are {', '.join(type(self).model_fields)}"
            )
        return self


class Devices(MotionLimits):
    """``[devices]``: the follower reads real devices, each by its driver."""

    runs_in: ClassVar[tuple[Service, ...]] = ("follower",)

    robot: Driver
    force_sensor: Driver | None = None
    accelerometer: Driver | None = None
    tool: str | None = Field(None, min_length=1)
    tool_axes: tuple[Literal["force", "acceleration"], ...] | None = None
    on_lost: Literal["stop", "hold", "retract"] = "stop"

    @model_validator(mode="after")
    def _tool_is_measured(self) -> Self:
        if self.tool is not None and (self.force_sensor is None or self.accelerometer is None):
            raise ValueError("tool: its load needs a force_sensor and an accelerometer on the tool")
        if self.tool is not None and len(set(self.tool_axes or ())) == 1:
            raise ValueError(
                "tool: its load turns with both sensors: name both in tool_axes, or neither"
            )
        return self
