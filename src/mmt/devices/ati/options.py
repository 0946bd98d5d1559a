"""Options that every force sensor by ATI takes, whichever way it is read."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-360, le=360)]


class AtiOptions(BaseModel):
    """What the sensor is expected to be, and how it is mounted."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    serial: str | None = None
    """Serial number that the calibration must have, as ``FT12345``."""
    calibration: str | None = None
    """Name that the calibration must have, as ``SI-12-0.12``."""
    force_unit: str | None = None
    """Unit of force that the device must be set to; any known one is converted where None."""
    range_n: tuple[Positive, Positive, Positive] | None = None
    """Calibrated range of Fx, Fy, Fz (N) that the device must have."""
    mounted: Literal["tool", "surface"] = "tool"
    """Whether the sensor carries the tool or the surface, whose force is of the other sign."""
    rotation_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    """Turns the sensor's axes into the scene's: about x, then y, then z of the scene."""
    latency_ms: float | None = Field(default=None, ge=0, le=1000)
    """From the force to the sensor's stamp; None for what the driver knows of it."""
    silence_ms: float = Field(default=200, ge=20, le=10_000)
    """Without a record for so long, the sensor is lost."""
    stuck_ms: float = Field(default=500, ge=0, le=60_000)
    """With the very same values for so long, the sensor is lost; 0 for never."""
