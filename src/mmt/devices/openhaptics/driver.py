"""What an arm and a handle share: one HD device from `connect` to `close`, in a scene's axes."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Generic

from mmt.devices.axes import Axes
from mmt.devices.openhaptics.device import AnyServo, HdDevice
from mmt.devices.openhaptics.library import Stack
from mmt.devices.openhaptics.options import HdOptions
from mmt.devices.protocols import Vector


class HdDriver(ABC, Generic[AnyServo]):
    """A `Device`; a driver adds its servo, and what is read and written.

    Parameters
    ----------
    options
        Checked already.
    """

    def __init__(self, options: HdOptions) -> None:
        self._axes = Axes(options.axes, options.origin_mm)
        self._device: HdDevice[AnyServo] = HdDevice(options, self._make_servo)

    @abstractmethod
    def _make_servo(
        self, stack: Stack, handle: int, limit_n: float, stiffness_n_mm: float
    ) -> AnyServo:
        """Make the callback; see `HdDevice`."""

    def connect(self) -> None:
        """Open it; there is no force until the first command.

        Raises
        ------
        MmtError
            It does not answer, or does not do what the options ask for.
        """
        self._device.connect()

    def calibrate(self) -> None:
        """Bring the encoders to their zero; the scene's zero is the option `origin_mm`.

        Raises
        ------
        MmtError
            The person must do something first; the message says what.
        """
        self._device.calibrate()

    def close(self) -> None:
        """Take the force away and release the device."""
        self._device.close()

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts by what went wrong and was survived."""
        return self._device.counts

    @staticmethod
    def _is_finite(servo: AnyServo, command: Vector) -> bool:
        """Return whether a command is one that can be obeyed; one that is not is counted."""
        x, y, z = command
        if math.isfinite(x + y + z):
            return True
        servo.counts["commands that are not finite"] += 1
        return False
