"""A serial line to a device: opened, read without waiting, lost, and opened again."""

from typing import Any, Final

import serial

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.serial_ports import close_port, empty_port, open_port, read_waiting

_AT_ONCE: Final = 16384


class SerialLine:
    """A line, closed at first; a driver adds its commands.

    Parameters
    ----------
    name
        Name of the device in messages.
    port
        Path of the port, as ``/dev/ttyUSB0``.
    baud
        Bits a second.
    **settings
        Further settings of `mmt.devices.serial_ports.open_port`.
    """

    def __init__(self, name: str, port: str, baud: int, **settings: Any) -> None:
        self.name = name
        self._path = port
        self._baud = baud
        self._settings = settings
        self._port: serial.Serial | None = None

    def open(self) -> None:
        """Open the port and discard its input buffer.

        Raises
        ------
        MmtError
            The port is missing, in use by another program, or not permitted.
        """
        self.close()
        try:
            self._port = open_port(self._path, self._baud, **self._settings)
        except MmtError as error:
            raise MmtError(f"{self.name}: its serial port: {error}") from error
        empty_port(self._port)

    def read(self) -> bytes:
        """Return the received bytes without waiting.

        Raises
        ------
        DeviceLost
            The port is closed, or gone.
        """
        try:
            return read_waiting(self._opened(), _AT_ONCE)
        except (OSError, TypeError) as error:  # TypeError: pyserial, when it is closed meanwhile
            raise self._lost(error) from error

    def write(self, content: bytes) -> None:
        """Send bytes.

        Raises
        ------
        DeviceLost
            The port is closed, or gone.
        """
        try:
            self._opened().write(content)
        except OSError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Close the port; calling it twice is harmless."""
        port, self._port = self._port, None
        close_port(port)

    def _opened(self) -> serial.Serial:
        if self._port is None:
            raise DeviceLost(f"{self.name} is closed: connect it again")
        return self._port

    def _lost(self, error: Exception) -> DeviceLost:
        return DeviceLost(
            f"{self.name}: the port is gone ({error}); plug it in again, and check that no other "
            "program uses the port"
        )
