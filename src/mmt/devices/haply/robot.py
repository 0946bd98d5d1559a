"""The follower's arm: an Inverse3 that its service holds at commanded positions."""

import time
from collections.abc import Callable
from typing import Any, Final

from mmt.core.arrays import towards
from mmt.devices.drivers import read_options
from mmt.devices.haply.driver import InverseDriver
from mmt.devices.haply.messages import position_command
from mmt.devices.haply.options import RobotOptions
from mmt.devices.haply.servo import Found, Servo
from mmt.devices.protocols import Vector

STUCK: Final = (
    "a position that stays the same though it is commanded elsewhere: let go of the tip; see that "
    "it has power and, in the Haply Hub, that no emergency brake is engaged; where it obeys no "
    "command at all, try the option 'commands'"
)

_STUCK_NS: Final = 500_000_000
"""A tip that is pulled as far as it may be moves by the least bit within this, unless it is held
fast, or the service does not obey."""
_LONGEST_STEP_S: Final = 0.005
_LONGEST_TURN_S: Final = 0.02
_SHORT_S: Final = 2e-5


class PositionServo(Servo):
    """A point that moves towards the target, at which the service holds the tip.

    The point starts where the tip is, moves at a bounded speed, and is never further from the tip
    than the option `lead_limit_mm`: the service's spring pulls no harder than over that distance,
    and neither the first command nor one after a pause throws the arm. While commands are stale
    the arm is limp.
    """

    def __init__(
        self,
        found: Found,
        options: RobotOptions,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(found, options.stale_ms, clock)
        self._speed_mm_s, self._lead_mm = options.speed_limit_mm_s, options.lead_limit_mm
        self.target_mm: Vector = (0.0, 0.0, 0.0)
        """In the device's axes."""
        self._point: Vector | None = None
        self._pulled_at: Vector | None = None
        self._pulled_ns = self._spoke_ns = 0

    def speak(self, now_ns: int) -> str:
        """Return the command of the next place, or of no force."""
        passed_s = min(1e-9 * (now_ns - self._spoke_ns), _LONGEST_STEP_S)
        self._spoke_ns = now_ns
        measured, command_ns = self.measured, self.command_ns
        fresh = command_ns is not None and now_ns - command_ns < self.stale_ns
        if measured is None or self.senseless is not None or self.fault or not fresh:
            if self._point is not None and not fresh:
                self.counts["stale commands"] += 1
            self._point = self._pulled_at = None
            return self.release()
        tip = measured.position_mm
        point = towards(self._point or tip, self.target_mm, self._speed_mm_s * passed_s)
        self._point = towards(tip, point, self._lead_mm)
        if self._point != point and tip == self._pulled_at:
            if now_ns - self._pulled_ns > _STUCK_NS:
                self.fault = STUCK
        else:
            self._pulled_at, self._pulled_ns = tip, now_ns
        return position_command(self.device, self._names, self._point)


class Inverse3Robot(InverseDriver[PositionServo]):
    """Implements `Robot`; the options are those of `RobotOptions`.

    Parameters
    ----------
    **options
        See `docs/how-to/inverse3.md`.

    Raises
    ------
    InputError
        An option is not allowed.
    """

    def __init__(self, **options: Any) -> None:
        self._of_robot = read_options(RobotOptions, "inverse3", options)
        super().__init__(self._of_robot)

    def _make_servo(self, found: Found) -> PositionServo:
        return PositionServo(found, self._of_robot)

    def await_turn(self) -> None:
        """Return soon after the service's next answer, or after 20 ms."""
        servo = self._check()
        answers, deadline = servo.answers, time.monotonic() + _LONGEST_TURN_S
        while servo.answers == answers and time.monotonic() < deadline:
            time.sleep(_SHORT_S)

    def read(self) -> Vector:
        """Return the tip's newest position (mm).

        Raises
        ------
        DeviceLost
            It does not answer any more.
        """
        return self._axes.place_in_scene(self._measured(self._check()).position_mm)

    def write(self, position_mm: Vector) -> None:
        """Command a position (mm); one that is not finite is counted and not obeyed.

        Raises
        ------
        DeviceLost
            It does not answer any more.
        """
        servo = self._check()
        if self._is_finite(servo, position_mm):
            servo.target_mm = self._axes.place_on_device(position_mm)
            servo.command_ns = servo.clock()
