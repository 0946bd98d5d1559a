"""Options of a board by NI."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator


class NiOptions(BaseModel):
    """Options of ``ni-daqmx``: inputs, wiring and rate."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    device: str | None = Field(None, pattern=r"^[A-Za-z0-9_.-]{1,255}$")
    """Name of the board in NI-DAQmx, such as ``Dev1``; None for the only board."""
    inputs: tuple[Annotated[int, Field(ge=0, le=255)], ...] = Field(
        (0, 1, 2, 3, 4, 5), min_length=1, max_length=32
    )
    """Numbers of the inputs, in the order of the voltages; 3 is ``ai3``."""
    terminals: Literal["differential", "rse", "nrse"] = "differential"
    """Reference of each input: its partner (``ai8`` for ``ai0``), ground, or AI SENSE."""
    range_v: float = Field(10.0, ge=0.05, le=10.0)
    """Largest magnitude to be measured (V); the board uses its next larger range."""
    rate_hz: float = Field(2000.0, ge=100.0, le=50_000.0)
    """Scans a second; the board uses the next rate that its clock offers."""

    @field_validator("inputs")
    @classmethod
    def _inputs_differ(cls, inputs: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(inputs)) < len(inputs):
            raise ValueError("each of them may be there once")
        return inputs
