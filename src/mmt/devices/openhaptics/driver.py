"""Base class of arm and handle: one HD device from `connect` to `close`, in a scene's axes."""

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
    """A `Device`; a subclass adds its servo, `read` and `write`.

    Parameters
    ----------
    options
        Validated options.
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
        """Open the device; there is no force until the first command.

        Raises
        ------
        MmtError
            The device does not answer, or cannot do what the options ask for.
        """
        self._device.connect()

    def calibrate(self) -> None:
        """Calibrate the encoders; the option `origin_mm` sets the scene's zero.

        Raises
        ------
        MmtError
            The operator must do something first; the message says what.
        """
        self._device.calibrate()

    def close(self) -> None:
        """Switch the force off and release the device."""
        self._device.close()

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of tolerated faults, by kind."""
        return self._device.counts

    @staticmethod
    def _is_finite(servo: AnyServo, command: Vector) -> bool:
        """Return whether a command is finite, and count it if it is not."""
        x, y, z = command
        if math.isfinite(x + y + z):
            return True
        servo.counts["commands that are not finite"] += 1
        return False
