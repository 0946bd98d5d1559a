"""The thread that sends an arm to its target, at the rate of its controller."""

import contextlib
import threading
import time
from typing import Any, Final

from mmt.core.errors import MmtError, short_message
from mmt.core.quaternions import Vector
from mmt_devices.universal_robots import dashboard
from mmt_devices.universal_robots.servo import ServoPoint, ServoSettings

WATCHDOG_HZ: Final = 10.0
"""Least rate of commands: below it the controller ends the program, and the arm stops."""

_STILL_S: Final = 0.5
_STILL_M: Final = 0.02
"""The arm does not follow if the tip stays exactly still for `_STILL_S`, at least this far from the
point that it is sent to."""

_SAFETY_BITS: Final = {
    2: "PROTECTIVE_STOP", 3: "RECOVERY", 4: "SAFEGUARD_STOP", 5: "SYSTEM_EMERGENCY_STOP",
    6: "ROBOT_EMERGENCY_STOP", 7: "ROBOT_EMERGENCY_STOP", 8: "VIOLATION", 9: "FAULT",
}  # fmt: skip
_RUNNING: Final = 7
_MODES: Final = {
    -1: "NO_CONTROLLER", 0: "DISCONNECTED", 1: "CONFIRM_SAFETY", 2: "BOOTING", 3: "POWER_OFF",
    4: "POWER_ON", 5: "IDLE", 6: "BACKDRIVE", 8: "UPDATING_FIRMWARE",
}  # fmt: skip
PLAYING: Final = 2
_PAUSED: Final = 4
_START_S: Final = 1.0
ZEROING_S: Final = 0.2
"""Time after a program's start in which an e-Series arm may still be zeroing its force sensor."""


class ArmControl(threading.Thread):
    """Thread that sends an arm its commands, through one control interface of ur_rtde.

    Calls of the interface wait for the controller, at worst forever. So this thread does nothing
    else, and another thread watches the arm.

    Parameters
    ----------
    host, frequency_hz
        Address and rate of the controller.
    settings
        Settings of the servo.
    receive
        Receive interface, which has data already.

    Attributes
    ----------
    target_m, force_n
        Target position and force on the tip, in the base's frame; set by another thread.
    lost
        Why the arm takes no commands any more, empty while it does.
    held_back
        Number of periods in which the force limit kept the point from going deeper.

    Raises
    ------
    MmtError
        The arm cannot be controlled.
    """

    def __init__(
        self, host: str, frequency_hz: float, settings: ServoSettings, receive: Any
    ) -> None:
        super().__init__(name="UR servo", daemon=True)
        self.target_m: Vector | None = None
        self.force_n: Vector = (0.0, 0.0, 0.0)
        self.lost = ""
        self.held_back = 0
        self._host, self._period_s = host, 1.0 / frequency_hz
        self._settings, self._receive = settings, receive
        self._ending, self._stopped = threading.Event(), threading.Event()
        self._explains = False
        self._control = self._take(frequency_hz)
        pose = receive.getActualTCPPose()
        self._point = ServoPoint(settings, pose[:3])
        self._rotation: list[float] = pose[3:]
        self._pose, self._still_since_s = pose, time.monotonic()

    def _take(self, frequency_hz: float) -> Any:
        import rtde_control

        try:
            control = rtde_control.RTDEControlInterface(self._host, frequency_hz)
            time.sleep(1.5 * ZEROING_S)  # then its force sensor has moved the bias
            guarded = control.setWatchdog(WATCHDOG_HZ)
            deadline = time.monotonic() + _START_S
            while self._receive.getRuntimeState() != PLAYING and time.monotonic() < deadline:
                time.sleep(0.001)  # `receive` reports it a cycle later
        except Exception as error:
            raise MmtError(
                f"the arm at {self._host} takes no commands ({short_message(error)}): read what "
                "the pendant shows; no other program may control it, and EtherNet/IP, PROFINET and "
                "MODBUS must be off in its installation"
            ) from error
        if not guarded:
            raise MmtError(f"the arm at {self._host} {self._why_not()}")
        return control

    def run(self) -> None:
        """Send commands until the arm is released, or takes no more commands."""
        try:
            due_s = time.monotonic()
            while not self.lost and not self._ending.is_set():
                if not self._drive():
                    self._lose(self._why_not())
                due_s = max(due_s + self._period_s, time.monotonic() - 10.0 * self._period_s)
                time.sleep(max(0.0, due_s - time.monotonic()))
            if not self.lost:
                if self.target_m is not None:
                    self._control.servoStop(self._settings.acceleration_m_s2)
                self._control.stopScript()
        except Exception as error:  # noqa: BLE001 - whatever the library raises is told
            self._lose(
                f"takes no commands any more ({short_message(error)}): check its cable, and that "
                "it is switched on"
            )
        self._stopped.set()
        self._control.disconnect()  # so that others may control the arm; takes half a second

    def release(self, patience_s: float) -> None:
        """Stop the arm and end its program; return then, or after `patience_s`."""
        self._ending.set()
        self._stopped.wait(patience_s)

    def watch(self) -> None:
        """Set `lost` if the newest data shows a problem; never blocks."""
        if self.lost or self._explains:
            return
        reason = self._problem(time.monotonic())
        if reason:
            self._lose(reason)
        elif self._receive.getRuntimeState() != PLAYING:
            self._explains = True  # in a thread: the dashboard server may be slow
            threading.Thread(target=lambda: self._lose(self._why_not()), daemon=True).start()

    def _lose(self, reason: str) -> None:
        self.lost = self.lost or reason

    def _problem(self, now_s: float) -> str:
        """Return what is wrong with the arm, empty if nothing is."""
        receive = self._receive
        mode = receive.getRobotMode()
        bits = receive.getSafetyStatusBits()  # after the mode, which a stop changes too
        for bit, name in _SAFETY_BITS.items():
            if bits >> bit & 1:
                return dashboard.SAFETY[name]
        if mode != _RUNNING:
            return dashboard.OFF.format(_MODES.get(mode, f"mode {mode}"))
        pose = receive.getActualTCPPose()
        way_m = max(abs(a - b) for a, b in zip(self._point.position_m, pose, strict=False))
        if pose != self._pose or way_m < _STILL_M:
            self._pose, self._still_since_s = pose, now_s
        if now_s - self._still_since_s < _STILL_S:
            return ""
        return (
            f"does not follow: its tip stays {1000.0 * way_m:.0f} mm away from where it is sent; "
            "check the speed slider at the pendant, and what holds the arm"
        )

    def _why_not(self) -> str:
        """Return why the control program does not run."""
        with contextlib.suppress(MmtError):
            reason = dashboard.problem(self._host)
            if reason:
                return reason
        if self._receive.getRuntimeState() == _PAUSED:
            return "does not go on: its program was paused at the pendant; press Stop there"
        return (
            "does not run the control program any more: Stop was pressed at the pendant, another "
            "program took over, or commands came too seldom; read the pendant's log"
        )

    def _drive(self) -> bool:
        """Send the next command; return whether the arm takes it."""
        target_m, settings = self.target_m, self._settings
        if target_m is None:
            return bool(self._control.kickWatchdog())
        place = self._point.move(target_m, self.force_n, self._period_s)
        self.held_back += self._point.held_back
        sent = self._control.servoL(
            [*place, *self._rotation],
            0.0,  # speed and acceleration, which the library does not use
            0.0,
            self._period_s,
            settings.lookahead_s,
            settings.gain,
        )
        return bool(sent)
