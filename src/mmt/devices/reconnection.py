"""Reconnect lost devices, and wrap the leader's devices, whose loss a session survives."""

import re
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final, Generic, Protocol, TypeVar

from mmt.core.arrays import FloatArray, Vector, difference, step_towards
from mmt.core.errors import DeviceLost
from mmt.devices.leader_reports import ActuatorStatistics, InterfaceState
from mmt.devices.protocols import Device, LeaderInterface, VibrationActuator

_RETRY_S: Final = 0.5
_LONGEST_RETRY_S: Final = 3.0
_BACK_OFF: Final = 1.5
"""Factor from one pause between tries to the next. A device that is away for long is not tried
twice a second, and one that was plugged in again is back within three seconds."""
_LAST_S: Final = 0.5
_MOST_REASONS: Final = 5
"""Reasons reported for one loss."""


class Reconnection(threading.Thread):
    """Close and connect a device until that works, in a thread, since it may take long.

    Parameters
    ----------
    device
        The device.
    reason
        Why it was lost.
    before
        The reconnection before this one. If the device is lost as soon as that has connected it,
        the first try waits too.
    """

    def __init__(
        self, device: Device, reason: str = "", before: "Reconnection | None" = None
    ) -> None:
        super().__init__(name=f"connect {type(device).__name__}", daemon=True)
        self._device = device
        self._given_up = threading.Event()
        self.connected_s = 0.0
        """Time at which the device was connected."""
        self._waits = before is not None and time.monotonic() - before.connected_s < _RETRY_S
        self.done = threading.Event()
        self.reason = reason
        """Why the last try failed; before the first try, why the device was lost."""
        self.start()

    def run(self) -> None:
        """Try until the device is connected or `give_up` is called."""
        pause_s = _RETRY_S
        self._given_up.wait(_RETRY_S if self._waits else 0.0)
        while not self._given_up.is_set():
            try:
                with suppress(BaseException):
                    self._device.close()
                self._device.connect()
            except BaseException as error:  # noqa: BLE001 - SystemExit too would end the thread
                self.reason = str(error) or type(error).__name__
                self._given_up.wait(pause_s)
                pause_s = min(_BACK_OFF * pause_s, _LONGEST_RETRY_S)
            else:
                self.connected_s = time.monotonic()
                self.done.set()
                break
        if self._given_up.is_set():
            with suppress(Exception):
                self._device.close()

    def give_up(self) -> None:
        """Try no more; if a running call still connects the device, it is closed afterwards."""
        self._given_up.set()
        self.join(_LAST_S)


class Reasons:
    """Reasons why a device is not there, each reported once.

    Reasons that differ only in their numbers count as the same.

    Parameters
    ----------
    first
        Reason that is reported already.
    """

    def __init__(self, first: str) -> None:
        self._told = {_gist(first)}

    def new(self, reason: str) -> str:
        """Return the reason if it has not been reported yet, else an empty text."""
        gist = _gist(reason)
        if not reason or gist in self._told or len(self._told) > _MOST_REASONS:
            return ""
        self._told.add(gist)
        return reason


def _gist(reason: str) -> str:
    return re.sub(r"[\d.]+", "", reason)


AnyDevice = TypeVar("AnyDevice", bound=Device)


class LossCallback(Protocol):
    """Called when a device is lost, when its reason changes, and when it is back."""

    def __call__(self, sentence: str, **details: object) -> None:
        """Take a sentence for the operator, and details for a program."""


def _ignore(sentence: str, **details: object) -> None:
    """Do nothing."""


class ReconnectingDevice(Generic[AnyDevice]):
    """A device that is reconnected when it is lost.

    Parameters
    ----------
    what
        Name of the device in messages and metrics.
    meanwhile
        What happens while the device is lost, for messages.
    device
        The driver; it raises `DeviceLost` if the device may come back.
    """

    def __init__(self, what: str, meanwhile: str, device: AnyDevice) -> None:
        self.what = what
        self.device = device
        self.losses = 0
        """How often it was lost."""
        self._meanwhile = meanwhile
        self._tell: LossCallback = _ignore
        self._reconnection: Reconnection | None = None
        self._earlier: Reconnection | None = None
        self._reason = ""
        self._reasons = Reasons("")
        self._lost_ns = 0
        self._away_ns = 0

    def watch(self, callback: LossCallback) -> None:
        """Set the function that is called on every loss and return."""
        self._tell = callback

    def connect(self) -> None:
        """Open the device."""
        self.device.connect()

    def calibrate(self) -> None:
        """Calibrate the device."""
        self.device.calibrate()

    def close(self) -> None:
        """Release the device; calling it twice is harmless."""
        if self._reconnection is not None:
            self._reconnection.give_up()
            self._away_ns += time.monotonic_ns() - self._lost_ns
            self._reconnection = None
        self.device.close()

    @property
    def lost(self) -> bool:
        """Whether the device was missing when it was last used."""
        return self._reconnection is not None

    @property
    def problem(self) -> str | None:
        """A sentence while the device is lost, else None."""
        if self._reconnection is None:
            return None
        return f"the {self.what} ({self.name}) is lost{f': {self._reason}' if self._reason else ''}"

    @property
    def name(self) -> str:
        """Name of the driver's class."""
        return type(self.device).__name__

    @property
    def losses_summary(self) -> dict[str, Any]:
        """Number and duration of the losses, for a program."""
        away_ns = self._away_ns
        if self._reconnection is not None:
            away_ns += time.monotonic_ns() - self._lost_ns
        return {"losses": self.losses, "lost_s": round(away_ns / 1e9, 3)}

    def _is_usable(self) -> bool:
        """Return whether the device may be used now, and report its return."""
        connecting = self._reconnection
        if connecting is None:
            return True
        if not connecting.done.is_set():
            if connecting.reason != self._reason:
                self._reason = connecting.reason
                if self._reasons.new(self._reason):
                    self._tell(
                        f"the {self.what} is not back yet: {self._reason}",
                        device=self.what,
                        state="lost",
                    )
            return False
        self._earlier, self._reconnection = connecting, None
        away_ns = time.monotonic_ns() - self._lost_ns
        self._away_ns += away_ns
        self._tell(
            f"the {self.what} is back after {away_ns / 1e9:.1f} s",
            device=self.what,
            state="back",
            lost_s=round(away_ns / 1e9, 3),
        )
        return True

    def _lose(self, error: DeviceLost) -> None:
        """Mark the device as lost and reconnect it, in a thread."""
        self.losses += 1
        self._lost_ns = time.monotonic_ns()
        self._reason = str(error)
        self._reasons = Reasons(self._reason)
        self._tell(
            f"the {self.what} ({self.name}) is lost: {error}; {self._meanwhile} until it is back",
            device=self.what,
            state="lost",
        )
        self._reconnection = Reconnection(self.device, self._reason, self._earlier)


class OperatorHandle(ReconnectingDevice[LeaderInterface]):
    """A handle that may be lost and return elsewhere, and the follower's position command.

    While it is lost it has no state and shows no force, and the command does not change: the robot
    holds. After the handle's return the difference between the command and the handle's position
    is reduced at a bounded speed, in addition to the hand's motion, so that the command does not
    jump.

    Parameters
    ----------
    device
        The handle's driver.
    recovery_mm
        Reduction of the difference in one tick, mm.
    """

    def __init__(self, device: LeaderInterface, recovery_mm: float) -> None:
        super().__init__("handle", "the robot stays where it is, force and vibration rest", device)
        self.not_finite = 0
        """Readings that were left out, since they were no numbers."""
        self._recovery_mm = recovery_mm
        self._offset: Vector | None = None
        self._read_losses = 0
        self.command_mm: Vector | None = None
        """The follower's position command (mm), or None before the handle was ever read."""

    def read(self, elapsed_ticks: int) -> InterfaceState | None:
        """Return the state now, None while the handle is lost or gives no finite numbers.

        Sets the command.
        """
        if not self._is_usable():
            return None
        try:
            state = self.device.read(elapsed_ticks)
        except DeviceLost as error:
            self._lose(error)
            return None
        if not state.is_finite:
            self.not_finite += 1
            return None
        self._follow(state.position_mm, elapsed_ticks)
        return state

    def _follow(self, position: Vector, elapsed_ticks: int) -> None:
        if self.losses != self._read_losses:  # returned, perhaps during an earlier `write`
            self._read_losses = self.losses
            if self.command_mm is not None:
                self._offset = difference(self.command_mm, position)
        if self._offset is None:
            self.command_mm = position
            return
        x, y, z = step_towards(self._offset, (0.0, 0.0, 0.0), self._recovery_mm * elapsed_ticks)
        self.command_mm = (position[0] + x, position[1] + y, position[2] + z)
        self._offset = (x, y, z) if x or y or z else None

    def write(self, force_n: Vector) -> None:
        """Display a force (N), unless the handle is lost."""
        if self._is_usable():
            try:
                self.device.write(force_n)
            except DeviceLost as error:
                self._lose(error)


class ReconnectingActuator(ReconnectingDevice[VibrationActuator]):
    """The actuator: while it is lost nothing is played, and the unplayed samples are counted."""

    def __init__(self, device: VibrationActuator) -> None:
        super().__init__("actuator", "there is no vibration", device)
        self.lost_samples = 0
        """Samples that were not played because the actuator was lost."""

    def write(self, samples_m_s2: Sequence[float] | FloatArray) -> None:
        """Play samples (n,), m/s2, or count them if the actuator is lost."""
        if self._is_usable():
            try:
                self.device.write(samples_m_s2)
            except DeviceLost as error:
                self._lose(error)
            else:
                return
        self.lost_samples += len(samples_m_s2)

    @property
    def statistics(self) -> ActuatorStatistics:
        """Counts and levels of the device."""
        return self.device.statistics

    @property
    def losses_summary(self) -> dict[str, Any]:
        """Number and duration of the losses, and the unplayed samples, for a program."""
        return {**super().losses_summary, "lost_samples": self.lost_samples}
