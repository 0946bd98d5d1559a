"""What an arm and a handle share: one Inverse3 from `connect` to `close`, in a scene's axes."""

import atexit
import logging
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Final, Generic

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.axes import Axes
from mmt.devices.haply.link import ServiceLink
from mmt.devices.haply.messages import NAMES, kind_of, listed, version_of
from mmt.devices.haply.options import InverseOptions
from mmt.devices.haply.servo import ABSENT, AnyServo, Found, Measured
from mmt.devices.protocols import Vector

LOG: Final = logging.getLogger("mmt.devices.haply")

_LOST_NS: Final = 100_000_000
_LEAST_ANSWERS: Final = 20
"""An answer that makes no sense is survived; so many, for so long, are a device that is lost."""
_POLL_S: Final = 0.02
_CALIBRATE: Final = (
    "put its grip where it is calibrated (the inkwell; see Haply's quick start) until its light "
    "shows that it is"
)


class InverseDriver(ABC, Generic[AnyServo]):
    """A `Device`; a driver adds its servo, and what is read and written.

    Parameters
    ----------
    options
        Checked already.
    """

    def __init__(self, options: InverseOptions) -> None:
        self._options = options
        self._axes = Axes(options.axes, options.origin_mm)
        self._link: ServiceLink[AnyServo] | None = None
        self._servo: AnyServo | None = None
        self._calibrated = False
        self.name = f"Inverse3 {options.device or ''}".rstrip() + f" at {options.address}"

    @abstractmethod
    def _make_servo(self, found: Found) -> AnyServo:
        """Make the servo of a device."""

    def connect(self) -> None:
        """Find the device; there is no force until the first command.

        Raises
        ------
        MmtError
            The service or the device is not there, or which of several is meant is not said.
        """
        self.close()
        options = self._options
        self._link = ServiceLink(options.address, options.timeout_ms, self._choose)
        try:
            self._servo = self._link.start()
            self.name = f"{self._servo.kind} {self._servo.device} at {options.address}"
            self._measured(self._servo)
            if self._calibrated:  # it comes back, perhaps from a loss of power
                self.calibrate()
        except BaseException:
            self.close()
            raise
        atexit.register(self.close)

    def _choose(self, message: dict[str, Any]) -> AnyServo:
        """Return the servo of the device that is meant among those of the first message."""
        there, wanted = listed(message), self._options.device
        names = ", ".join(f"{name!r} ({kind_of(entry)})" for name, entry in there.items())
        where = f"the Haply Inverse Service at {self._options.address}"
        if not there:
            raise MmtError(
                f"{where} knows no Inverse3: plug it in and switch it on; the Haply Hub shows it "
                "when it is there"
            )
        if wanted is None and len(there) > 1:
            raise MmtError(f"{where} has {names}: name one by the option 'device'")
        device = next(iter(there)) if wanted is None else wanted
        if device not in there:
            raise MmtError(f"{where} has no device {device!r}, but {names}: correct 'device'")
        entry, commands = dict(there[device]), self._options.commands
        version = version_of(message, entry) if commands == "auto" else commands
        return self._make_servo(Found(device, NAMES[version], entry))

    def calibrate(self) -> None:
        """Wait until the device is calibrated; the scene's zero is the option `origin_mm`.

        Raises
        ------
        MmtError
            The person must do something first; the message says what.
        """
        servo = self._check()
        began, told = time.monotonic(), False
        while servo.calibrated is False:
            if time.monotonic() - began > self._options.calibration_s:
                raise MmtError(f"{self.name} is not calibrated: {_CALIBRATE}")
            if not told:
                LOG.warning("%s is not calibrated: %s", self.name, _CALIBRATE)
                told = True
            time.sleep(_POLL_S)
            self._check()
        servo.needs_calibration = self._calibrated = True

    def close(self) -> None:
        """Take the force away and leave the service; calling it twice is harmless."""
        atexit.unregister(self.close)
        link, self._link = self._link, None
        if link is not None:
            link.stop()

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts by what went wrong and was survived, of the newest connection."""
        return {} if self._servo is None else dict(self._servo.counts)

    def remarks(self) -> Sequence[str]:
        """Return a sentence for each thing that is doubtful about the device."""
        servo = self._servo
        if servo is None:
            return []
        doubtful = (
            (
                servo.powered is False,
                "has no power supply and thus no force: plug it in",
            ),
            (servo.used_elsewhere, "is used by another program as well: end that one"),
            (servo.calibrated is False, f"is not calibrated: {_CALIBRATE}"),
        )
        return [f"{self.name} {remark}" for applies, remark in doubtful if applies]

    def _check(self) -> AnyServo:
        """Return the servo of a device that works.

        Raises
        ------
        DeviceLost
            It does not answer any more.
        MmtError
            The driver itself failed.
        """
        link, servo = self._link, self._servo
        if link is None or servo is None:
            raise DeviceLost(f"{self.name} is not connected: connect it first")
        link.check()
        if servo.fault:
            raise DeviceLost(f"{self.name} has given {servo.fault}")
        senseless = servo.senseless
        if (
            senseless is not None
            and senseless.answers >= _LEAST_ANSWERS
            and servo.clock() - senseless.since_ns > _LOST_NS
        ):
            if senseless.problem == ABSENT:
                raise DeviceLost(
                    f"the service does not list {self.name} any more: check its cable and power"
                )
            raise DeviceLost(
                f"{self.name} has given {senseless.problem} for 100 ms or more, so that there is "
                "no force: check its cable and calibration, and what the Haply Hub shows of it"
            )
        return servo

    def _measured(self, servo: AnyServo) -> Measured:
        """Return the newest state that makes sense."""
        if servo.measured is None:
            raise DeviceLost(
                f"{self.name} gives no position that makes sense: check its cable and calibration, "
                "and what the Haply Hub shows of it"
            )
        return servo.measured

    @staticmethod
    def _is_finite(servo: AnyServo, command: Vector) -> bool:
        """Return whether a command is one that can be obeyed; one that is not is counted."""
        if math.isfinite(sum(command)):
            return True
        servo.counts["commands that are not finite"] += 1
        return False
