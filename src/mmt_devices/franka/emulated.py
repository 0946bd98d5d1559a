"""Emulated Franka arm, behind the part of franky's interface that the driver uses.

It stands in for library and robot together, to test the driver's own logic: the tip follows its
reference with a lag, and stops on demand. The real library is tested with a simulator that speaks
the robot's protocol (`docs/how-to/franka.md`).
"""

import importlib.machinery
import math
import sys
import threading
import time
import types
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, Vector

_LAG_S: Final = 0.02
_REST_S: Final = 0.02


class NetworkException(Exception):  # noqa: N818 - named as the library's
    """The connection is gone, or there is none."""


class ControlException(Exception):  # noqa: N818
    """The motion was ended."""


class RealtimeConfig(Enum):
    """As the library's."""

    Enforce = 0
    Ignore = 1


class RobotMode(Enum):
    """As the library's."""

    Other = 0
    Idle = 1
    Move = 2
    Guiding = 3
    Reflex = 4
    UserStopped = 5
    AutomaticErrorRecovery = 6


@dataclass
class Affine:
    """A translation (m) and a rotation, as the quaternion (x, y, z, w)."""

    translation: Any
    quaternion: Any


@dataclass
class Twist:
    """A velocity (m/s)."""

    linear_velocity: Any


@dataclass
class CartesianReference:
    """Pose and velocity that the tip is to follow."""

    target: Affine
    target_twist: Twist | None = None


@dataclass
class PostureTask:
    """Joint angles at which the posture is held, and the stiffness."""

    target: Any
    stiffness: float


@dataclass
class CartesianImpedanceTrackingMotion:
    """A motion towards the newest reference."""

    translational_stiffness: float
    rotational_stiffness: float
    translational_error_clip: list[float]
    posture_task: PostureTask
    reference: CartesianReference | None = None

    def set_reference(self, reference: CartesianReference) -> None:
        """Set the newest reference."""
        self.reference = reference


class TorqueStopMotion:
    """A motion that brings the arm to rest."""


@dataclass
class RobotState:
    """The fields of the library's state that the driver uses."""

    O_T_EE: Affine
    O_F_ext_hat_K: FloatArray
    q: FloatArray
    robot_mode: RobotMode
    current_errors: list[str]
    time: "Milliseconds"


@dataclass
class Milliseconds:
    """A time of the robot's clock."""

    value: int

    def to_msec(self) -> int:
        """Return the time in ms."""
        return self.value


@dataclass
class EmulatedFranka:
    """The arm: its measurements, and its faults on demand.

    Attributes
    ----------
    position_m, pushes_n
        Position of the tip, and force (N) of the tip on what it touches, in the base frame.
    rotation
        Quaternion (x, y, z, w) of the tip in the base frame; the tool points down at first.
    mode, errors
        Mode of the robot, and its errors.
    powered, answering
        Whether the arm has power, and whether its states advance.
    recoverable
        Whether a recovery succeeds.
    motions
        All motions begun so far.
    """

    position_m: FloatArray = field(default_factory=lambda: np.array([0.5, 0.0, 0.3]))
    rotation: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    pushes_n: Vector = (0.0, 0.0, 0.0)
    mode: RobotMode = RobotMode.Idle
    errors: list[str] = field(default_factory=list)
    powered: bool = True
    answering: bool = True
    recoverable: bool = True
    recoveries: int = 0
    collisions: tuple[float, float] | None = None
    connections: int = 0
    realtime: RealtimeConfig | None = None
    motions: list[Any] = field(default_factory=list)
    end: str = ""
    """Why the newest motion was ended, empty if it was not."""
    _moving: Any = None
    _moved_s: float = 0.0
    _began_s: float = field(default_factory=time.monotonic)
    lock: Any = field(default_factory=threading.RLock)

    def stop(self, text: str, mode: RobotMode = RobotMode.Reflex, error: str = "") -> None:
        """End the motion, as a reflex or the user stop does, with the library's text."""
        with self.lock:
            self.mode, self.errors = mode, [error] if error else []
            if self._moving is not None:
                self._moving, self.end = None, text

    def state(self) -> RobotState:
        """Return the newest state; if nothing moves, wait 1 ms for it."""
        if not self.moving:
            time.sleep(0.001)
        with self.lock:
            if not self.powered:
                raise NetworkException("libfranka: UDP receive: Timeout")
            now_s = time.monotonic()
            if self.answering:
                self._advance(now_s - self._moved_s)
                self._moved_s = now_s
            return RobotState(
                Affine(self.position_m.copy(), self.rotation.copy()),
                np.array([*self.pushes_n, 0.0, 0.0, 0.0]),
                np.array([0.0, 0.0, 0.0, -1.6, 0.0, 1.6, 0.8]),
                self.mode,
                list(self.errors),
                Milliseconds(int(1e3 * (self._moved_s - self._began_s))),
            )

    def _advance(self, passed_s: float) -> None:
        motion = self._moving
        if isinstance(motion, TorqueStopMotion):
            if time.monotonic() - self._rested_s > _REST_S:
                self._moving = None
        elif motion is not None:
            target = np.array(motion.reference.target.translation)
            share = 1.0 - math.exp(-passed_s / _LAG_S)
            self.position_m += share * (target - self.position_m)

    def begin(self, motion: Any) -> None:
        """Begin a motion in place of the running one."""
        with self.lock:
            self.motions.append(motion)
            self._moving, self.end = motion, ""
            self._rested_s = time.monotonic()

    @property
    def moving(self) -> bool:
        """Whether a motion runs."""
        return self._moving is not None

    def recover(self) -> bool:
        """Recover from errors; return whether that succeeded."""
        self.recoveries += 1
        if self.recoverable:
            self.mode, self.errors = RobotMode.Idle, []
        return self.recoverable

    def disconnect(self) -> None:
        """Free the connection, and stop a running motion."""
        self.connections -= 1
        self._moving = None

    @contextmanager
    def library(self) -> Iterator[None]:
        """Make ``import franky`` give the stand-in within the context."""
        before = sys.modules.get("franky")
        sys.modules["franky"] = self._module()
        try:
            yield
        finally:
            del sys.modules["franky"]
            if before is not None:
                sys.modules["franky"] = before

    def _module(self) -> types.ModuleType:
        module = types.ModuleType("franky")
        module.__spec__ = importlib.machinery.ModuleSpec("franky", None)
        names = (Affine, Twist, CartesianReference, PostureTask, RealtimeConfig, TorqueStopMotion)
        for each in (*names, CartesianImpedanceTrackingMotion):
            setattr(module, each.__name__, each)
        module.Robot = lambda host, realtime_config: Robot(  # type: ignore[attr-defined]
            self, host, realtime_config
        )
        return module


class Robot:
    """A connection to the emulated arm, which takes one at a time."""

    def __init__(self, arm: EmulatedFranka, host: str, realtime_config: RealtimeConfig) -> None:
        if not arm.powered or arm.connections or host != "arm":
            raise NetworkException("libfranka: Connection to FCI refused. Please install FCI ...")
        self._arm = arm
        arm.connections += 1
        arm.realtime = realtime_config
        weakref.finalize(self, arm.disconnect)

    @property
    def state(self) -> RobotState:
        """The newest state."""
        return self._arm.state()

    @property
    def has_errors(self) -> bool:
        """Whether there are errors."""
        return bool(self._arm.errors)

    def recover_from_errors(self) -> bool:
        """Recover from errors; return whether that succeeded."""
        return self._arm.recover()

    def set_collision_behavior(self, torque_nm: float, force_n: float) -> None:
        """Set the torque and force that count as a collision."""
        self._arm.collisions = (torque_nm, force_n)

    def move(self, motion: Any, *, asynchronous: bool) -> None:
        """Begin a motion, which runs on without the caller."""
        assert asynchronous  # noqa: S101 - the driver must not wait for a motion
        self._arm.begin(motion)

    @property
    def is_in_control(self) -> bool:
        """Whether a motion runs."""
        return self._arm.moving

    def join_motion(self) -> None:
        """Raise an exception with the reason if the motion was ended early."""
        end, self._arm.end = self._arm.end, ""
        if end:
            raise ControlException(end)


for _each in (NetworkException, ControlException):
    _each.__module__ = "franky"
