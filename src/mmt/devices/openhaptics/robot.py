"""The follower's arm: a Phantom or Touch that is held at commanded positions."""

import math
from ctypes import c_uint32
from ctypes.util import find_library
from typing import Any, Final

from mmt.core.arrays import Vector, step_towards
from mmt.core.errors import InputError
from mmt.core.quaternions import Quaternion, quaternion_of_axes
from mmt.devices.openhaptics.driver import HdDriver
from mmt.devices.openhaptics.library import CURRENT_TRANSFORM, Matrix, Stack
from mmt.devices.openhaptics.options import HdRobotOptions
from mmt.devices.openhaptics.servo import STUCK, Servo

_LONGEST_STEP_S: Final = 0.005
_TRANSFORM: Final = c_uint32(CURRENT_TRANSFORM)
_STUCK_NS: Final = 200_000_000
"""A position that stays exactly the same for this long under the largest force is stuck."""


def missing() -> str:
    """Return what this machine lacks for the driver, with what to do; empty if nothing."""
    if find_library("HD") is not None:
        return ""
    return (
        "the vendor's library (libHD) is not where the system looks: install the vendor's "
        "OpenHaptics package, or give its path by the option 'library'"
    )


class PositionServo(Servo):
    """Position controller: a spring to a point that moves towards the target, and a damper.

    The point starts at the tip and moves at a bounded speed, so that neither the first command
    nor one after a pause jerks the arm.

    Parameters
    ----------
    options
        Gains and limits.
    limit_n
        Largest force, along any direction.
    """

    def __init__(
        self, hd: Any, copies: Any, handle: int, options: HdRobotOptions, limit_n: float
    ) -> None:
        super().__init__(hd, copies, handle, options, limit_n)
        self.target: Vector = (0.0, 0.0, 0.0)
        self.limit_n = limit_n
        self._stiffness = options.stiffness_n_mm
        self._damping = options.damping_n_s_m / 1000.0
        self._speed = options.speed_limit_mm_s
        self._point = (0.0, 0.0, 0.0)
        self._pushed_at = (0.0, 0.0, 0.0)
        self._pushed_ns = 0
        self.turns = False
        """Whether the orientation of the stylus is measured, from the next tick on."""
        self.transform: tuple[float, ...] = (0.0,) * 16
        """Newest transform of the stylus, column by column, replaced as a whole."""
        self._matrix = Matrix()

    def _measure(self, now_ns: int) -> None:
        super()._measure(now_ns)
        if self.turns:
            self._get(_TRANSFORM, self._matrix)
            self.transform = tuple(self._matrix)

    def drive(self, now_ns: int) -> Vector:
        """Return the force of this tick, before it is limited and faded."""
        x, y, z = self.position
        if self.share == 0.0:
            self._point = (x, y, z)
            self._pushed_ns = now_ns
            return (0.0, 0.0, 0.0)
        passed_s = min(1e-9 * (now_ns - self.tick_ns), _LONGEST_STEP_S)
        a, b, c = self._point = step_towards(self._point, self.target, self._speed * passed_s)
        u, v, w = self.velocity
        stiffness, damping = self._stiffness, self._damping
        fx = stiffness * (a - x) - damping * u
        fy = stiffness * (b - y) - damping * v
        fz = stiffness * (c - z) - damping * w
        within = math.hypot(fx, fy, fz) <= self.limit_n
        if self.share < 1.0 or within or (x, y, z) != self._pushed_at:
            self._pushed_at, self._pushed_ns = (x, y, z), now_ns
        elif now_ns - self._pushed_ns > _STUCK_NS:
            self.distrust(STUCK, now_ns - _STUCK_NS)
        return (fx, fy, fz)


class OpenHapticsRobot(HdDriver[PositionServo]):
    """Implements `Robot`; see `docs/how-to/openhaptics.md`."""

    OPTIONS = HdRobotOptions

    def __init__(self, options: HdRobotOptions) -> None:
        super().__init__(options)
        self._options: HdRobotOptions = options

    def _make_servo(
        self, stack: Stack, handle: int, limit_n: float, stiffness_n_mm: float
    ) -> PositionServo:
        if self._options.stiffness_n_mm > stiffness_n_mm:
            raise InputError(
                f"{self.name}: stiffness_n_mm is {self._options.stiffness_n_mm:g}, the "
                f"device displays at most {stiffness_n_mm:g}: lower it"
            )
        return PositionServo(stack.hd, stack.copies, handle, self._options, limit_n)

    def read(self) -> Vector:
        """Return the tip's position (mm), at most a tick old."""
        return self._axes.place_in_scene(self.check().position)

    def orientation(self) -> Quaternion:
        """Return the orientation (w, x, y, z) of the stylus, at most a tick old.

        It is measured from the first call on, whose own result is no unit quaternion.
        """
        servo = self.check()
        servo.turns = True
        a, b, c, _, d, e, f, _, g, h, i, *_ = servo.transform
        return self._axes.turn_in_scene(quaternion_of_axes((a, b, c), (d, e, f), (g, h, i)))

    def write(self, position_mm: Vector) -> None:
        """Command a position (mm); one that is not finite is counted and ignored."""
        servo = self.check()
        if servo.accepts(position_mm):
            servo.target = self._axes.place_on_device(position_mm)
            servo.command_ns = servo.clock()
