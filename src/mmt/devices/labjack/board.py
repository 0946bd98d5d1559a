"""``labjack-u6``: a LabJack U6 as the board of a sensor that gives bare voltages."""

from collections import Counter
from collections.abc import Sequence
from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from mmt.core.errors import DeviceLost, InputError
from mmt.devices.discovery import missing_libusb
from mmt.devices.drivers import read_options
from mmt.devices.labjack.packets import GAINS, AnalogInput
from mmt.devices.labjack.sharing import (
    INPUTS,
    MOST_SAMPLES_HZ,
    SharedU6,
    U6Reader,
    connect,
    disconnect,
)
from mmt.devices.protocols import VoltageReading

missing = missing_libusb


class U6Voltages:
    """A `VoltageBoard` that streams inputs at an even rate.

    Several may read one U6 at the same time, each its own inputs.

    Parameters
    ----------
    channels
        The inputs, in the order of the volts; 1 to 14.
    rate_hz
        Scans a second, 100 and above; with the inputs, 50 000 samples a second.
    box
        Serial number of the U6; None takes the only one.
    backend
        The pyusb backend; None takes the one that the system has.

    Raises
    ------
    InputError
        A channel or the rate is not allowed.
    """

    def __init__(
        self,
        channels: Sequence[AnalogInput],
        rate_hz: float = 1000.0,
        box: int | None = None,
        backend: Any = None,
    ) -> None:
        _check(channels, rate_hz)
        self.inputs = len(channels)
        """How many voltages a reading has."""
        self.limit_v = min(10.0 / channel.gain for channel in channels)
        """Largest magnitude that every input measures."""
        self.latency_ns = 0
        """A scan is stamped when it begins; its inputs follow each other within it."""
        self._reader = U6Reader(channels, rate_hz, box, backend)
        self._board: SharedU6 | None = None

    @property
    def serial(self) -> int:
        """Serial number of the U6 that is connected."""
        return 0 if self._board is None else self._board.serial

    @property
    def arrival_ns(self) -> int:
        """When the newest scan that `read` has returned had come, by the host's clock."""
        return self._reader.arrival_ns

    @property
    def faults(self) -> Counter[str]:
        """``bad packets``, ``lost scans``, ``overflows`` and, by their number, errors."""
        return Counter(self._reader.faults)  # which another driver's thread may be adding to

    def connect(self) -> None:
        """Open the U6, read its calibration, start the stream; or join one that runs.

        Raises
        ------
        InputError
            Another driver reads the same U6 with settings that do not go with these.
        MmtError
            It is not there, may not be opened, or refuses.
        """
        self.close()
        self._board = connect(self._reader)

    def read(self) -> list[VoltageReading]:
        """Return what has come, oldest first, by the U6's clock; never blocks.

        Raises
        ------
        DeviceLost
            It was unplugged, or is not open.
        """
        if self._board is None:
            raise DeviceLost("the LabJack U6 is not open: connect it again")
        return self._board.read(self._reader)

    def close(self) -> None:
        """Let the U6 go, whose stream ends with its last reader; calling it twice is harmless."""
        board, self._board = self._board, None
        if board is not None:
            disconnect(board, self._reader)


def _check(channels: Sequence[AnalogInput], rate_hz: float) -> None:
    if not 1 <= len(channels) <= INPUTS:
        raise InputError(f"a LabJack U6 has {INPUTS} inputs, not {len(channels)}")
    if not rate_hz >= 100.0:
        raise InputError(f"rate_hz {rate_hz:g}: a LabJack U6 is read at 100 Hz and above here")
    if rate_hz * len(channels) > MOST_SAMPLES_HZ:
        raise InputError(
            f"rate_hz {rate_hz:g}: a LabJack U6 takes {MOST_SAMPLES_HZ} samples a second, which "
            f"is {MOST_SAMPLES_HZ / len(channels):.0f} Hz for {len(channels)} inputs"
        )
    for channel in channels:
        if channel.gain not in GAINS:
            raise InputError(f"gain {channel.gain}: a LabJack U6 has 1, 10, 100 and 1000")
        if not 0 <= channel.number < INPUTS:
            raise InputError(f"input {channel.number}: a LabJack U6 has 0 to 13")
        if channel.differential and channel.number % 2:
            raise InputError(
                f"input {channel.number}: a differential one is named by its even half"
            )


NAME: Final = "labjack-u6"


class BoardOptions(BaseModel):
    """Which inputs, how fast and how amplified."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    inputs: tuple[int, ...] = Field((0, 1, 2, 3, 4, 5), min_length=1, max_length=14)
    """In the order of the voltages; 0 to 13."""
    differential: bool = False
    """Each against the next input of its pair; the inputs are then even."""
    gain: Literal[1, 10, 100, 1000] = 1
    """Gain of every input: +-10 V, +-1 V, +-0.1 V, +-0.01 V."""
    rate_hz: float = Field(2000.0, ge=100.0, le=MOST_SAMPLES_HZ)
    """Readings a second."""
    box: int | None = Field(None, ge=1)
    """Serial number of the U6; None takes the only one."""


def labjack_u6(*, backend: Any = None, **options: Any) -> U6Voltages:
    """Make the board; see `BoardOptions`.

    Parameters
    ----------
    backend
        The pyusb backend; None takes the one that the system has.
    options
        As the scene gives them.

    Raises
    ------
    InputError
        An option is not allowed.
    """
    checked = read_options(BoardOptions, NAME, options)
    channels = [AnalogInput(n, checked.gain, checked.differential) for n in checked.inputs]
    return U6Voltages(channels, checked.rate_hz, checked.box, backend)
