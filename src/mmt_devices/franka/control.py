"""Position control of the arm."""

from typing import Any, Final

from mmt.core.arrays import Vector, difference, step_towards
from mmt_devices.franka.options import FrankaRobotOptions
from mmt_devices.franka.problems import ArmProblem

_LONGEST_STEP_S: Final = 0.005
_SMOOTHING_S: Final = 0.01
"""Time constant that smooths the point's velocity, a difference of positions."""


class PositionControl:
    """Holds the tip by a spring and a damper at a point that moves towards the target.

    This class moves the point, at a bounded speed. The library closes the loop, 1000 times a second
    in a thread that runs no Python (`CartesianImpedanceTrackingMotion` of franky, on libfranka's
    torque interface). Nothing moves before the first command. The damper acts on the tip's velocity
    relative to the point, so that damping does not make the tip lag behind.

    Parameters
    ----------
    franky
        The library.
    options
        Stiffness and limits.

    Attributes
    ----------
    target_mm
        Commanded position of the tip, in the robot's base frame; None before the first command.
    left
        Set to True to bring the arm to rest, and to end the control.
    """

    def __init__(self, franky: Any, options: FrankaRobotOptions) -> None:
        self._franky = franky
        self._options = options
        self.target_mm: Vector | None = None
        self.left = False
        self._resting = False
        self._motion: Any = None
        self._rotation: Any = None
        self._point = self._velocity = (0.0, 0.0, 0.0)
        self._moved_ns = 0

    def step(self, robot: Any, state: Any, now_ns: int) -> bool:
        """Begin once there is a command, then advance the point; return whether control has ended.

        Raises
        ------
        Exception
            Any exception of the library, if the arm has stopped.
        """
        target = self.target_mm
        if self.left:
            return self._rest(robot)
        if target is None:
            return False
        if self._motion is None:
            self._begin(robot, state, now_ns)
        elif not robot.is_in_control:
            robot.join_motion()
            raise ArmProblem("the library has ended the motion without a reason")
        else:
            self._move(target, 1e-9 * (now_ns - self._moved_ns))
            self._moved_ns = now_ns
            self._publish()
        return False

    def _rest(self, robot: Any) -> bool:
        """Bring the arm to rest if it was moved; return whether it is at rest."""
        if self._motion is None:
            return True
        if not self._resting:
            self._resting = True
            robot.move(self._franky.TorqueStopMotion(), asynchronous=True)
        elif not robot.is_in_control:
            robot.join_motion()
            self._motion = None
        return self._motion is None

    def _begin(self, robot: Any, state: Any, now_ns: int) -> None:
        options, franky = self._options, self._franky
        robot.set_collision_behavior(options.collision_torque_nm, options.collision_force_n)
        stiffness_n_m = 1000.0 * options.stiffness_n_mm
        motion = franky.CartesianImpedanceTrackingMotion(
            translational_stiffness=stiffness_n_m,
            rotational_stiffness=options.rotational_stiffness_nm_rad,
            translational_error_clip=[options.force_limit_n / stiffness_n_m] * 3,
            posture_task=franky.PostureTask(
                target=state.q, stiffness=options.posture_stiffness_nm_rad
            ),
        )
        x, y, z = state.O_T_EE.translation.tolist()
        self._point = (1e3 * x, 1e3 * y, 1e3 * z)
        self._rotation = state.O_T_EE.quaternion
        self._motion, self._moved_ns = motion, now_ns
        self._publish()
        robot.move(motion, asynchronous=True)

    def _move(self, target: Vector, passed_s: float) -> None:
        """Move the point towards the target (mm), and update its smoothed velocity (mm/s)."""
        step_s = min(max(passed_s, 1e-6), _LONGEST_STEP_S)
        point = step_towards(self._point, target, self._options.speed_limit_mm_s * step_s)
        (x, y, z), self._point = difference(point, self._point), point
        share = step_s / (step_s + _SMOOTHING_S)
        u, v, w = self._velocity
        self._velocity = (
            u + share * (x / step_s - u),
            v + share * (y / step_s - v),
            w + share * (z / step_s - w),
        )

    def _publish(self) -> None:
        """Hand the point to the library's loop, which takes it in its next turn."""
        franky = self._franky
        point_m = [1e-3 * value for value in self._point]
        velocity_m_s = [1e-3 * value for value in self._velocity]
        self._motion.set_reference(
            franky.CartesianReference(
                target=franky.Affine(point_m, self._rotation),
                target_twist=franky.Twist(velocity_m_s),
            )
        )
