"""Options of all Haptuator drivers."""

import math
from collections.abc import Sequence
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from mmt.core.arrays import FloatArray
from mmt.core.frames import MOST_SAMPLES

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

LARGEST_HZ = 500.0 * MOST_SAMPLES
"""Half the largest rate of a session's acceleration."""
DATA_SHEET_LOW_HZ = 90.0
DATA_SHEET_HIGH_HZ = 1000.0
"""The band of a TL002-14R."""


class HaptuatorOptions(BaseModel):
    """Limits, band and level of the actuator."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    volts_per_m_s2: float | None = Field(default=None, gt=0, le=100)
    """Voltage at the actuator for 1 m/s2; None takes the value stored for `serial`."""
    serial: str | None = Field(default=None, min_length=1)
    """Serial number under which its level and equaliser are stored."""
    full_scale_v: float = Field(gt=0, le=100)
    """Voltage at the actuator for the largest number that the converter takes."""
    limit_v: float = Field(default=3.0, gt=0, le=100)
    """Largest voltage that the actuator may get."""
    low_hz: float | None = Field(default=None, ge=1, le=400)
    """The actuator is not driven below this, by a second-order high-pass. None takes the value of
    the sweep stored for `serial`, or the data sheet's `DATA_SHEET_LOW_HZ` without a sweep."""
    high_hz: float = Field(default=DATA_SHEET_HIGH_HZ, ge=20, le=LARGEST_HZ)
    """The actuator is not driven above this, by a second-order low-pass if the rate allows it."""

    @model_validator(mode="after")
    def _band(self) -> Self:
        if self.low_hz is not None and self.high_hz <= self.low_hz:
            raise ValueError(
                f"high_hz {self.high_hz:g} must be above low_hz {self.low_hz:g}: nothing would pass"
            )
        if (self.volts_per_m_s2 is None) == (self.serial is None):
            raise ValueError(
                "the level is needed once: give volts_per_m_s2, or the serial under which it is "
                "stored"
            )
        return self

    @property
    def largest_v(self) -> float:
        """Largest voltage (V): the lower limit of actuator and amplifier."""
        return min(self.limit_v, self.full_scale_v)

    def clip(self, volts: Sequence[float] | FloatArray) -> list[float]:
        """Return voltages cut to the limit; those that are not finite become 0."""
        most = self.largest_v
        return [min(max(float(v), -most), most) if math.isfinite(v) else 0.0 for v in volts]
