"""``ni-daqmx``: an NI acquisition board for sensors with voltage outputs."""

from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from mmt.devices.board_sharing import BoardStream, ChannelsOf, SharedInputs
from mmt.devices.discovery import lacking
from mmt_devices.ni.daqmx import LOCAL, Daqmx, explained, find_board, find_ports, input_names
from mmt_devices.ni.stream import NiInput, NiStream


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


RATES: Final = (
    "100 to 50000 scans a second (rate_hz); of all inputs together as many samples as the board "
    "takes, a PCIe-6323 250000, a USB-6251 1000000"
)
FINDERS: Final = {"NI boards": find_ports}


missing = lacking(find_ports)


class NiVoltages(SharedInputs[NiInput]):
    """`VoltageBoard` that samples inputs at a constant rate; several drivers may share a board.

    Parameters
    ----------
    options
        Validated options.
    daqmx
        Access to NI-DAQmx.
    """

    OPTIONS = NiOptions
    what = "board by NI"

    def __init__(self, options: NiOptions, daqmx: Daqmx = LOCAL) -> None:
        inputs = [NiInput(n, options.terminals, options.range_v) for n in options.inputs]
        super().__init__(inputs, options.rate_hz, options.range_v, options.device, daqmx)

    def require_one(self) -> None:
        """Raise unless exactly one board fits the option `device`."""
        self._device()

    def open_stream(self, channels_of: ChannelsOf[NiInput]) -> BoardStream:
        """Start a task."""
        device = self._device()
        return NiStream(self.backend, device, self.rate_hz, channels_of(device.name))

    def conflict_with(self, others: Sequence[SharedInputs[NiInput]]) -> str:
        """Return why one task cannot sample these inputs and the others'; empty if it can."""
        numbers = {each.number for each in self.channels}
        taken = {each.number for other in others for each in other.channels}
        if twice := sorted(numbers & taken):
            return f"ai{twice[0]} belongs to another driver already"
        device = self._device()
        with explained():
            there = input_names(device)
            most_hz = device.ai_max_multi_chan_rate
        if strange := [f"ai{number}" for number in sorted(numbers) if f"ai{number}" not in there]:
            return f"{device.name} has no {strange[0]}, but {len(there)} inputs from {there[0]} on"
        samples_hz = self.rate_hz * (len(numbers) + len(taken))
        if samples_hz > most_hz:
            return (
                f"{samples_hz:.0f} samples a second are more than the {most_hz:.0f} that "
                f"{device.name} ({device.product_type}) takes of all inputs together: lower "
                "rate_hz of each"
            )
        return ""

    def _device(self) -> Any:
        return find_board(self.backend, None if self.board is None else str(self.board))
