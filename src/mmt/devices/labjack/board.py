"""``labjack-u6``: a LabJack U6 as the board of a sensor that gives bare volts."""

from collections.abc import Iterable, Sequence
from typing import Any, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from mmt.devices.board_sharing import BoardStream, ChannelsOf, SharedInputs
from mmt.devices.discovery import missing_libusb
from mmt.devices.labjack.packets import AnalogInput
from mmt.devices.labjack.usb_link import U6Stream, check_alone, find_boxes

missing = missing_libusb

INPUTS: Final = 14
MOST_SAMPLES_HZ: Final = 50_000
"""Largest rate of all channels together (the vendor's data sheet, section 3.2)."""

RATES: Final = f"100 to {MOST_SAMPLES_HZ} samples a second (rate_hz), of all inputs together"


class BoardOptions(BaseModel):
    """Inputs, rate and gain of the board."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    inputs: tuple[int, ...] = Field((0, 1, 2, 3, 4, 5), min_length=1, max_length=14)
    """Inputs in the order of the voltages, 0 to 13."""
    differential: bool = False
    """Measure each input against the next one of its pair; the inputs must then be even."""
    gain: Literal[1, 10, 100, 1000] = 1
    """Gain of every input: +-10 V, +-1 V, +-0.1 V, +-0.01 V."""
    rate_hz: float = Field(2000.0, ge=100.0, le=MOST_SAMPLES_HZ)
    """Readings a second."""
    box: int | None = Field(None, ge=1)
    """Serial number of the U6; None takes the only one."""

    @model_validator(mode="after")
    def _fit_the_box(self) -> Self:
        for number in self.inputs:
            if not 0 <= number < INPUTS:
                raise ValueError(f"input {number}: a LabJack U6 has 0 to 13")
            if self.differential and number % 2:
                raise ValueError(f"input {number}: a differential one is named by its even half")
        if self.rate_hz * len(self.inputs) > MOST_SAMPLES_HZ:
            raise ValueError(
                f"rate_hz {self.rate_hz:g}: a LabJack U6 takes {MOST_SAMPLES_HZ} samples a second, "
                f"which is {MOST_SAMPLES_HZ / len(self.inputs):.0f} Hz for {len(self.inputs)} "
                "inputs"
            )
        return self


class U6Voltages(SharedInputs[AnalogInput]):
    """A `VoltageBoard` that streams inputs at an even rate.

    Several drivers may read one U6 at the same time, each with its own inputs.

    Parameters
    ----------
    options
        See `BoardOptions`.
    backend
        The pyusb backend; None takes the one that the system has.
    """

    OPTIONS = BoardOptions
    what = "LabJack U6"

    def __init__(self, options: BoardOptions, backend: Any = None) -> None:
        channels = [AnalogInput(n, options.gain, options.differential) for n in options.inputs]
        super().__init__(channels, options.rate_hz, 10.0 / options.gain, options.box, backend)

    def require_one(self) -> None:
        """Raise if several U6 are connected."""
        check_alone(find_boxes(self.backend))

    def open_stream(self, channels_of: ChannelsOf[AnalogInput]) -> BoardStream:
        """Open the U6, read its calibration, start the stream."""
        box = self.board
        assert not isinstance(box, str)  # noqa: S101 - as it was given
        return U6Stream(box, self.backend, self.rate_hz, channels_of)

    def conflict_with(self, others: Sequence[SharedInputs[AnalogInput]]) -> str:
        """Return why one stream cannot hold these inputs and the others', or ''."""
        taken = {number for other in others for number in terminals(other.channels)}
        wanted = terminals(self.channels)
        free = set(range(INPUTS)) - taken
        if len(free) < len(wanted):
            return (
                f"the others take {len(taken)} of its {INPUTS} inputs (a differential one takes "
                f"two), so that {len(wanted)} more do not fit: measure single-ended"
            )
        if twice := sorted(wanted & taken):
            return (
                f"input {_listed(twice)} belongs to another driver already: choose from "
                f"{_listed(sorted(free))}"
            )
        samples_hz = self.rate_hz * sum(each.inputs for each in [self, *others])
        if samples_hz > MOST_SAMPLES_HZ:
            return (
                f"{samples_hz:.0f} samples a second are more than its {MOST_SAMPLES_HZ}: lower "
                "rate_hz of each"
            )
        return ""


def terminals(channels: Iterable[AnalogInput]) -> set[int]:
    """Return the inputs that channels occupy; a differential channel occupies two."""
    return {c.number + half for c in channels for half in range(1 + c.differential)}


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))
