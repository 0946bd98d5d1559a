"""A serial port, read without waiting; what goes wrong with it, in sentences."""

import contextlib
import os
from typing import Final

import serial
from serial.tools import list_ports

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.serial_ports import explain_refusal, read_waiting

_AT_ONCE: Final = 16384


class SerialBoard:
    """The bytes of a microcontroller.

    Parameters
    ----------
    port, baud_rate
        As in `mmt.devices.adxl335.options.SerialOptions`.
    """

    def __init__(self, port: str, baud_rate: int) -> None:
        self.name = port
        self._baud_rate = baud_rate
        self._port: serial.Serial | None = None

    def open(self) -> None:
        """Open the port, and throw away what waits in it.

        Raises
        ------
        MmtError
            There is none, somebody else has it, or it is not permitted.
        """
        self.close()
        try:
            self._port = serial.Serial(self.name, self._baud_rate, timeout=0, exclusive=True)
        except (serial.SerialException, OSError, ValueError) as error:
            raise MmtError(
                f"the accelerometer's port {self.name}: {explain_refusal(error)}"
            ) from error
        # A converter from USB to serial gathers bytes for 16 ms unless told otherwise.
        with contextlib.suppress(AttributeError, NotImplementedError, ValueError, OSError):
            self._port.set_low_latency_mode(True)
        with contextlib.suppress(OSError, serial.SerialException):
            self._port.reset_input_buffer()

    def read(self) -> bytes:
        """Return what has come.

        Raises
        ------
        DeviceLost
            It is not open, or was unplugged.
        """
        if self._port is None:
            raise DeviceLost(f"the accelerometer's port {self.name} is not open")
        try:
            return read_waiting(self._port, _AT_ONCE)
        except (serial.SerialException, OSError, TypeError) as error:
            raise DeviceLost(
                f"the accelerometer's board on {self.name} is gone: plug it in again, and check "
                "that no other program reads the port"
            ) from error

    def close(self) -> None:
        """Close the port; calling it twice is harmless."""
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(OSError, serial.SerialException):
                port.close()

    def serial_number(self) -> str | None:
        """Return the number that the board gives over USB, None where there is none."""
        here = os.path.realpath(self.name)
        for info in list_ports.comports():
            if os.path.realpath(info.device) == here:
                number: str | None = info.serial_number
                return number
        return None
