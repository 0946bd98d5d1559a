"""An open serial line to a sensor that takes commands and then sends by itself."""

from typing import Any, Final

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.serial_ports import close_port, open_port, read_waiting

_AT_ONCE: Final = 4096


class SensorLine:
    """An open line; a driver adds its commands.

    Parameters
    ----------
    port
        Path of the port, as ``/dev/ttyUSB0``.
    baud
        Bits a second.
    name
        Name of the device in messages.
    **settings
        Further settings of `mmt.devices.serial_ports.open_port`.

    Raises
    ------
    MmtError
        The port cannot be opened.
    """

    def __init__(self, port: str, baud: int, name: str, **settings: Any) -> None:
        self._name = name
        try:
            self._serial = open_port(port, baud, write_timeout=1, **settings)
        except MmtError as error:
            raise MmtError(f"{name}: its serial port: {error}") from error

    def read(self) -> bytes:
        """Return the received bytes without waiting.

        Raises
        ------
        DeviceLost
            The port is gone.
        """
        try:
            return read_waiting(self._serial, _AT_ONCE)
        except (OSError, TypeError) as error:  # TypeError: pyserial, when it is closed meanwhile
            raise self._lost(error) from error

    def write(self, content: bytes) -> None:
        """Send bytes.

        Raises
        ------
        DeviceLost
            The port is gone.
        """
        try:
            self._serial.write(content)
        except OSError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Close the port; calling it twice is harmless."""
        close_port(self._serial)

    def _lost(self, error: Exception) -> DeviceLost:
        return DeviceLost(f"{self._name}: the port is gone ({error}); plug the adapter in again")
