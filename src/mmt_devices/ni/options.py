"""Options of a board by NI."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator


class NiOptions(BaseModel):
    """Which inputs, how they are wired, and how fast."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    device: str | None = Field(None, pattern=r"^[A-Za-z0-9_.-]{1,255}$")
    """Its name in NI-DAQmx, as ``Dev1``; None takes the only board."""
    inputs: tuple[Annotated[int, Field(ge=0, le=255)], ...] = Field(
        (0, 1, 2, 3, 4, 5), min_length=1, max_length=32
    )
    """In the order of the voltages: 3 is ``ai3``."""
    terminals: Literal["differential", "rse", "nrse"] = "differential"
    """Each against its partner (``ai0`` against ``ai8``), against ground, or against AI SENSE."""
    range_v: float = Field(10.0, ge=0.05, le=10.0)
    """Largest magnitude to be measured; the board takes its next range that holds it."""
    rate_hz: float = Field(2000.0, ge=100.0, le=50_000.0)
    """Scans a second; the board takes the next rate that its clock has."""

    @field_validator("inputs")
    @classmethod
    def _inputs_differ(cls, inputs: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(inputs)) < len(inputs):
            raise ValueError("each of them may be there once")
        return inputs
