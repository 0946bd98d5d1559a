"""``adxl335-u6``: an ADXL335 at three inputs of a LabJack U6."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, cast

from pydantic import Field, field_validator

from mmt.devices.adxl335.options import BAND, Adxl335Options
from mmt.devices.adxl335.sensor import Adxl335
from mmt.devices.discovery import missing_libusb
from mmt.devices.drivers import read_options
from mmt.devices.labjack.board import U6Voltages
from mmt.devices.labjack.packets import AnalogInput
from mmt.devices.labjack.sharing import MOST_SAMPLES_HZ
from mmt.devices.protocols import Vector

NAME: Final = "adxl335-u6"
MOST_HZ: Final = MOST_SAMPLES_HZ // 3
"""Of three inputs at the converter's quickest resolution, by which a U6 is streamed here."""

RATES: Final = f"100 to {MOST_HZ} samples a second (rate_hz); {BAND}"

missing = missing_libusb


class U6Options(Adxl335Options):
    """Options of a sensor at a LabJack U6."""

    box: int | None = Field(None, ge=1)
    """Serial number of the U6; None takes the only one."""
    inputs: tuple[int, int, int] = (0, 1, 2)
    """To which the sensor's X, Y, Z go; 0 to 13."""
    rate_hz: float = Field(2000.0, ge=100.0, le=MOST_HZ)
    """Samples a second; twice those of the frames keep vibration up to half of these."""

    @field_validator("inputs")
    @classmethod
    def _inputs_differ(cls, inputs: tuple[int, int, int]) -> tuple[int, int, int]:
        if len(set(inputs)) < 3 or not all(0 <= number <= 13 for number in inputs):
            raise ValueError("inputs must be three different ones of 0 to 13")
        return inputs


class U6Adxl335(Adxl335):
    """Reads three single-ended inputs at +-10 V, streamed.

    Parameters
    ----------
    backend
        The pyusb backend; None takes the one that the system has.
    options
        See `U6Options`.

    Raises
    ------
    InputError
        An option is not allowed.
    """

    def __init__(self, *, backend: Any = None, **options: Any) -> None:
        checked = read_options(U6Options, NAME, options)
        super().__init__(checked)
        channels = [AnalogInput(number) for number in checked.inputs]
        self._source = U6Voltages(channels, checked.rate_hz, checked.box, backend)

    @property
    def arrival_ns(self) -> int:
        """When the newest reading that `read` has returned had come, by the host's clock."""
        return self._source.arrival_ns

    def connect(self) -> None:
        """Open the U6 and start its stream.

        Raises
        ------
        MmtError
            It is not there, may not be opened, or refuses.
        """
        self._source.connect()
        self._prepare(f"u6-{self._source.serial}")

    def voltages(self) -> Sequence[tuple[int, Vector]]:
        """Return what has come as (time_ns, volts along the sensor's own axes).

        Raises
        ------
        DeviceLost
            It was unplugged.
        """
        return cast(Sequence[tuple[int, Vector]], self._source.read())

    def close(self) -> None:
        """End the stream; calling it twice is harmless."""
        self._source.close()

    def _counters(self) -> Sequence[Mapping[str, int]]:
        return (self._source.faults, *super()._counters())
