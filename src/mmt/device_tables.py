"""The scene's tables that name drivers."""

from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

DRIVER_PATTERN: Final = r"^([\w-]+|[\w.]+:\w+)$"
"""A driver's name, as in ``ati-net-ft``, or ``package.module:factory``."""


class Driver(BaseModel):
    """A driver and its options, which the driver itself checks; a name alone is short for it."""

    model_config = ConfigDict(extra="allow", frozen=True)

    driver: str = Field(pattern=DRIVER_PATTERN)

    @model_validator(mode="before")
    @classmethod
    def _short(cls, given: Any) -> Any:
        return {"driver": given} if isinstance(given, str) else given

    @property
    def options(self) -> dict[str, Any]:
        """The keys beside ``driver``, as the scene gives them."""
        return dict(self.model_extra or {})


class Devices(BaseModel):
    """``[devices]``: the follower reads real devices, each by its driver."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    robot: Driver
    force_sensor: Driver | None = None
    accelerometer: Driver | None = None
    on_lost: Literal["stop", "hold", "retract"] = "stop"
