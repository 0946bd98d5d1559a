"""``labjack-u6``: a LabJack U6 as the board of a sensor that gives bare voltages."""

from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from mmt.devices.drivers import read_options
from mmt.devices.labjack.packets import Channel
from mmt.devices.labjack.voltages import U6Voltages

NAME: Final = "labjack-u6"


class BoardOptions(BaseModel):
    """Which inputs, how fast and how amplified."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    inputs: tuple[int, ...] = Field((0, 1, 2, 3, 4, 5), min_length=1, max_length=14)
    """In the order of the voltages; 0 to 13."""
    differential: bool = False
    """Each against the next input of its pair; the inputs are then even."""
    gain: Literal[1, 10, 100, 1000] = 1
    """Of every input: +-10 V, +-1 V, +-0.1 V, +-0.01 V."""
    rate_hz: float = Field(2000.0, ge=100.0, le=4000.0)
    """Readings a second."""
    box: int | None = Field(None, ge=1)
    """Serial number of the U6; None takes the only one."""


def labjack_u6(*, backend: Any = None, **options: Any) -> U6Voltages:
    """Make the board; see `BoardOptions`.

    Parameters
    ----------
    backend
        Of pyusb; None takes what the system has.
    options
        As the scene gives them.

    Raises
    ------
    InputError
        An option is not allowed.
    """
    checked = read_options(BoardOptions, NAME, options)
    channels = [Channel(n, checked.gain, checked.differential) for n in checked.inputs]
    return U6Voltages(channels, checked.rate_hz, checked.box, backend)
