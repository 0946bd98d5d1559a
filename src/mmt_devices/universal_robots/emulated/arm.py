"""The emulated arm: its control program, its servo, its safety."""

import random
from collections.abc import Mapping
from typing import Any, Final, Protocol

from mmt.core.arrays import Vector, difference
from mmt_devices.universal_robots.frame import SceneFrame

NO_COMMAND: Final = 0
SERVO_STOP: Final = 16
SERVO_LINEAR: Final = 24
SET_WATCHDOG: Final = 35
END: Final = 255
"""Commands of ur_rtde, in input register 0."""
READY: Final = 1
DONE: Final = 2
"""Answers of the control script, in output register 0."""

RUNNING: Final = 7
POWER_OFF: Final = 3
"""Modes of the robot."""
STOPPED: Final = 1
PLAYING: Final = 2
PAUSED: Final = 4
"""States of the program."""
NORMAL: Final = 1 << 0
PROTECTIVE_STOP: Final = 1 << 2 | 1 << 10
EMERGENCY_STOP: Final = 1 << 6 | 1 << 7 | 1 << 10
"""Bits of the safety status."""
_POWER_ON: Final = 1 << 0
_PROGRAM_RUNS: Final = 1 << 1
_SAFETY_MODES: Final = {NORMAL: 1, PROTECTIVE_STOP: 3, EMERGENCY_STOP: 7}

TOOL_DOWN_RAD: Final[Vector] = (2.2, 2.2, 0.0)
"""Rotation vector of a tool that points roughly down."""


class ArmTip(Protocol):
    """Tip that the arm moves, in its own frame (mm, N): see `mmt.testing.emulated.lab.World`."""

    command_mm: Vector | None

    def position_mm(self, time_ns: int) -> Vector:
        """Return the position of the tip."""

    def force_n(self, time_ns: int) -> Vector:
        """Return the force of the surface on the tip."""


class Values(dict[str, Any]):
    """Fields by their names; a register that was never written is zero."""

    def __missing__(self, name: str) -> int:
        return 0


class EmulatedArm:
    """An arm that obeys the register commands of ur_rtde's control script.

    The script itself is not interpreted. The commands are: servo, stop the servo, set a watchdog,
    and end the program. Any other command ends the program, as an error in a script does. The point
    that the tip is drawn to follows the commanded pose with two equal real poles, so it trails a
    steady motion by the lookahead time; the gain has no effect. Both are our choice: how a real arm
    servoes is not published.

    Parameters
    ----------
    tip
        Tip that the arm moves.
    frame
        The tip's frame in the base's frame.
    noise_n
        Standard deviation of the measured force, which looks stuck without noise.
    seed
        Seed of the noise.
    """

    def __init__(self, tip: ArmTip, frame: SceneFrame, noise_n: float, seed: int) -> None:
        self.rotation_rad = TOOL_DOWN_RAD
        self.mode, self.safety = RUNNING, NORMAL
        self.runtime_state = STOPPED
        self.stuck = False
        """Whether measurements stay the same, while time goes on."""
        self.inputs, self.outputs = Values(), Values()
        self._tip, self._frame, self.noise_n = tip, frame, noise_n
        self._zero_n: Vector = (0.0, 0.0, 0.0)
        self._zeroing = False
        self._random = random.Random(seed)  # noqa: S311 - noise, no secret
        self._executing = False
        self._target_m: Vector | None = None
        self._point_m, self._speed_m_s = [0.0] * 3, [0.0] * 3
        self._pole_hz = 0.0
        self._watchdog_s = self._input_s = 0.0
        self._measured: dict[str, Any] = {}

    # --- the program

    def start_program(self) -> None:
        """Run the control script if safety and power allow it; its start zeroes the sensor."""
        if self.mode == RUNNING and self.safety == NORMAL:
            self._watchdog_s, self._executing, self._zeroing = 0.0, False, True
            self.runtime_state = PLAYING

    def end_program(self) -> None:
        """End the program; the arm stays where it is."""
        self.runtime_state = STOPPED
        self._target_m = None
        self.outputs["output_int_register_0"] = 0

    def set_registers(self, values: Mapping[str, Any], time_s: float) -> None:
        """Take the input registers of a data package."""
        self.inputs.update(values)
        self._input_s = time_s

    def step(self, time_s: float, now_ns: int, period_s: float) -> None:
        """Do a cycle of the controller."""
        if self.runtime_state == PLAYING:
            if 0.0 < self._watchdog_s < time_s - self._input_s:
                self.end_program()
            else:
                self._obey(now_ns)
        if self._target_m is not None:
            self._move(self._target_m, period_s)
        if not self.stuck or not self._measured:
            self._measured = self._measure(now_ns)

    def _obey(self, now_ns: int) -> None:
        command = self.inputs["input_int_register_0"]
        if command == SERVO_LINEAR:
            self._servo([self.inputs[f"input_double_register_{i}"] for i in range(11)], now_ns)
        elif command == NO_COMMAND:
            self._executing = False
        elif not self._executing:
            self._executing = True
            self._execute(command)
            return
        if self.runtime_state == PLAYING and not self._executing:
            self.outputs["output_int_register_0"] = READY

    def _execute(self, command: int) -> None:
        first = self.inputs["input_double_register_0"]
        if command == SERVO_STOP:
            self._target_m = None
        elif command == SET_WATCHDOG:
            self._watchdog_s = 1.0 / first
        else:  # END, or an unknown command
            self.end_program()
            return
        self.outputs["output_int_register_0"] = DONE

    def _servo(self, values: list[float], now_ns: int) -> None:
        if self._target_m is None:
            self._point_m = list(self._frame.place_in_base(self._tip.position_mm(now_ns)))
            self._speed_m_s = [0.0] * 3
        x, y, z, u, v, w, _speed, _acceleration, _time_s, lookahead_s, _gain = values
        self._target_m, self.rotation_rad = (x, y, z), (u, v, w)
        self._pole_hz = 2.0 / lookahead_s

    def _move(self, target_m: Vector, period_s: float) -> None:
        point, speed, pole = self._point_m, self._speed_m_s, self._pole_hz
        for axis, goal in enumerate(target_m):
            push = pole * (goal - point[axis]) - 2.0 * speed[axis]
            speed[axis] += period_s * pole * push
            point[axis] += period_s * speed[axis]
        self._tip.command_mm = self._frame.place_in_scene(point)

    # --- safety

    def protective_stop(self) -> None:
        """Stop, with the program paused, as after a collision."""
        self.safety, self.runtime_state, self._target_m = PROTECTIVE_STOP, PAUSED, None

    def emergency_stop(self) -> None:
        """Stop and cut the power, as by the red button."""
        self.end_program()
        self.safety, self.mode = EMERGENCY_STOP, POWER_OFF

    def restore(self) -> None:
        """Unlock the stop, switch on and release the brakes, as a person does at the pendant."""
        self.safety, self.mode = NORMAL, RUNNING

    # --- what is measured

    def _measure(self, now_ns: int) -> dict[str, Any]:
        place = self._frame.place_in_base(self._tip.position_mm(now_ns))
        force = self._frame.to_base(self._tip.force_n(now_ns))
        if self._zeroing:
            self._zero_n, self._zeroing = force, False
        force = difference(force, self._zero_n)
        noise = self._random.gauss
        return {
            "actual_TCP_pose": (*place, *self.rotation_rad),
            "actual_TCP_force": (*(each + noise(0.0, self.noise_n) for each in force), 0, 0, 0),
        }

    def fields(self, time_s: float) -> Values:
        """Return all fields that a data package may have, by name."""
        runs = self.runtime_state == PLAYING
        powered = self.mode != POWER_OFF
        return Values(
            self.outputs,
            timestamp=time_s,
            robot_mode=self.mode,
            safety_mode=_SAFETY_MODES[self.safety],
            safety_status_bits=self.safety,
            runtime_state=self.runtime_state,
            robot_status_bits=_POWER_ON * powered | _PROGRAM_RUNS * runs,
            **self._measured,
        )
