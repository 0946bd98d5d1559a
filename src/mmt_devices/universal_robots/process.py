"""The process that talks to an arm through ur_rtde, on behalf of a driver.

The library needs a separate process. Its constructors hold the interpreter until the controller has
answered. A lost connection leaves threads behind that hang, or that connect and start the arm again
by themselves. In this process they block nothing else, and end with it.
"""

import math
import time
from typing import Any, Final

from mmt.core.errors import MmtError, short_message
from mmt.devices.driver_process import COUNT, LOST, STATE, DriverPipes, run_process
from mmt_devices.universal_robots.control import PLAYING, ArmControl
from mmt_devices.universal_robots.messages import UrState
from mmt_devices.universal_robots.servo import ServoSettings

_FIELDS: Final = [
    "timestamp", "actual_TCP_pose", "actual_TCP_force", "robot_mode", "runtime_state",
    "safety_status_bits",
]  # fmt: skip
_FIRST_S: Final = 2.0
_SILENT_S: Final = 0.5
_SILENT_CYCLES: Final = 20
"""A loss also takes this many cycles without new data, since the host may have been held up."""
_RELEASE_S: Final = 3.0
_PRESSED_N: Final = 10.0
"""More than a free tool feels after the sensor was zeroed."""
_NO_DATA: Final = (
    "the UR controller at {} gives no data by RTDE{}: check that it is switched on and started, "
    "that RTDE is enabled (Settings, Security, Services), and that its software is 3.4 or later"
)


class ArmProcess:
    """Reads and moves one arm, until the driver has gone.

    Parameters
    ----------
    host, frequency_hz
        Address and rate of the controller.
    servo
        Fields of `ServoSettings`; None if the arm is only read.
    again
        Whether the arm was moved by this session before.
    pipes
        Pipes to the driver.
    """

    def __init__(
        self,
        host: str,
        frequency_hz: float,
        servo: dict[str, Any] | None,
        again: bool,
        pipes: DriverPipes,
    ) -> None:
        self._host, self._frequency_hz = host, frequency_hz
        self._settings = None if servo is None else ServoSettings(**servo)
        self._again, self._pipes = again, pipes
        self._receive: Any = None
        self._control: ArmControl | None = None
        self._held_back = 0
        self._timestamp_s = self._changed_s = 0.0
        self._empty = 0

    def run(self) -> None:
        """Talk to the arm until the driver has gone.

        Raises
        ------
        MmtError
            The arm does not answer, or no longer answers.
        """
        self._connect()
        if self._settings is not None:
            if self._again:
                self._require_free_tool()
            self._control = ArmControl(
                self._host, self._frequency_hz, self._settings, self._receive
            )
            self._control.start()
        period_s = 1.0 / self._frequency_hz
        due_s = time.monotonic()
        while self._take_commands():
            self._pass_state_on()
            self._watch_control()
            due_s = max(due_s + period_s, time.monotonic() - 10.0 * period_s)
            time.sleep(max(0.0, due_s - time.monotonic()))
        if self._control is not None:
            self._control.release(_RELEASE_S)

    def _connect(self) -> None:
        """Connect, and wait for the first data."""
        import rtde_receive

        try:
            self._receive = rtde_receive.RTDEReceiveInterface(
                self._host, self._frequency_hz, _FIELDS
            )
        except Exception as error:
            raise MmtError(_NO_DATA.format(self._host, f" ({short_message(error)})")) from error
        deadline = time.monotonic() + _FIRST_S
        while not self._receive.getTimestamp():
            if time.monotonic() > deadline:
                raise MmtError(_NO_DATA.format(self._host, ""))
            time.sleep(0.001)
        self._changed_s = time.monotonic()

    def _require_free_tool(self) -> None:
        """Raise if the tool is pressed: zeroed so, the sensor would hide that from all limits."""
        pressed_n = math.hypot(*self._receive.getActualTCPForce()[:3])
        if pressed_n > _PRESSED_N:
            raise MmtError(
                f"the tool of the arm at {self._host} feels {pressed_n:.0f} N, and the arm zeroes "
                "its force sensor when its program starts: free the tool; if it is free, start "
                "and stop any program at the pendant"
            )

    def _take_commands(self) -> bool:
        """Take the driver's commands; return whether the driver is still there."""
        commands = self._pipes.receive()
        if commands and self._control is not None:
            _, self._control.target_m = commands[-1]
        return commands is not None

    def _pass_state_on(self) -> None:
        """Read the arm, and send the driver its state if that is new."""
        receive, now_s = self._receive, time.monotonic()
        timestamp_s = receive.getTimestamp()
        if timestamp_s == self._timestamp_s:
            self._empty += 1
            silent = self._empty >= _SILENT_CYCLES and now_s - self._changed_s > _SILENT_S
            if silent or not receive.isConnected():
                raise MmtError(
                    f"the UR controller at {self._host} sends nothing any more: check its cable "
                    "and that it is switched on"
                )
            return
        self._timestamp_s, self._changed_s, self._empty = timestamp_s, now_s, 0
        (x, y, z, a, b, c), (u, v, w, *_) = receive.getActualTCPPose(), receive.getActualTCPForce()
        if self._control is not None:
            self._control.force_n = (u, v, w)
        runs = receive.getRuntimeState() == PLAYING
        now_ns = time.monotonic_ns()
        state = UrState(timestamp_s, (x, y, z), (u, v, w), now_ns, (a, b, c), runs)
        self._pipes.send(STATE, state)

    def _watch_control(self) -> None:
        """Tell the driver of periods held back, and of a loss of control."""
        control = self._control
        if control is None:
            return
        control.watch()
        if control.held_back != self._held_back:
            self._held_back = control.held_back
            self._pipes.send(COUNT, "periods held back by force_limit_n")
        lost = control.lost
        if lost and self._pipes.send(LOST, f"the arm at {self._host} {lost}"):
            self._control = None


_KEPT: Final[list[ArmProcess]] = []
"""Keeps the object alive, since destructors of the library would block."""


def run(arguments: dict[str, Any], pipes: DriverPipes) -> None:
    """Talk to the arm that the arguments name until the driver has gone."""
    _KEPT.append(ArmProcess(**arguments, pipes=pipes))
    _KEPT[0].run()


if __name__ == "__main__":
    run_process(run, "the UR arm")
