"""A Franka arm in software, behind the part of franky's interface that the driver uses.

It is a stand-in for the library and the robot together, for the driver's own logic: the tip
follows its reference with a lag, and stops on demand. What the library makes of a robot is tried
with a simulator that speaks the robot's protocol (`docs/how-to/franka.md`).
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

from mmt.core.arrays import FloatArray
from mmt.devices.protocols import Vector

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
    """A translation (m) and a rotation."""

    translation: Any
    quaternion: Any


@dataclass
class Twist:
    """A velocity (m/s)."""

    linear_velocity: Any


@dataclass
class CartesianReference:
    """What the tip is to follow."""

    target: Affine
    target_twist: Twist | None = None


@dataclass
class PostureTask:
    """What the elbow is held at."""

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
        """Set where the tip is to be."""
        self.reference = reference


class TorqueStopMotion:
    """A motion that comes to rest."""


@dataclass
class RobotState:
    """What a state has of the library's."""

    O_T_EE: Affine
    O_F_ext_hat_K: FloatArray
    q: FloatArray
    robot_mode: RobotMode
    current_errors: list[str]
    time: "Milliseconds"


@dataclass
class Milliseconds:
    """The robot's clock."""

    value: int

    def to_msec(self) -> int:
        """Return it."""
        return self.value


@dataclass
class EmulatedFranka:
    """The arm: what it measures, and what befalls it.

    Attributes
    ----------
    position_m, pushes_n
        Where its tip is, and with what force it pushes what it touches; its base frame.
    mode, errors
        What it is in, and why.
    powered, answering
        Whether it has power, and whether its states go on.
    recoverable
        Whether a recovery helps.
    motions
        Those that were begun.
    """

    position_m: FloatArray = field(default_factory=lambda: np.array([0.5, 0.0, 0.3]))
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
    """Why the newest motion has ended."""
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
        """Return a state; where nothing moves the next one is waited for."""
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
                Affine(self.position_m.copy(), (1.0, 0.0, 0.0, 0.0)),
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
        """Take a motion in the place of the one that runs."""
        with self.lock:
            self.motions.append(motion)
            self._moving, self.end = motion, ""
            self._rested_s = time.monotonic()

    @property
    def moving(self) -> bool:
        """Whether a motion runs."""
        return self._moving is not None

    def recover(self) -> bool:
        """Recover it from its errors; return whether that has helped."""
        self.recoveries += 1
        if self.recoverable:
            self.mode, self.errors = RobotMode.Idle, []
        return self.recoverable

    def disconnect(self) -> None:
        """Give the connection back, and stop what moves."""
        self.connections -= 1
        self._moving = None

    @contextmanager
    def library(self) -> Iterator[None]:
        """Have ``import franky`` give the stand-in meanwhile."""
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
        """Recover, and return whether that has helped."""
        return self._arm.recover()

    def set_collision_behavior(self, torque_nm: float, force_n: float) -> None:
        """Set what is taken for a collision."""
        self._arm.collisions = (torque_nm, force_n)

    def move(self, motion: Any, *, asynchronous: bool) -> None:
        """Begin a motion, which goes on by itself."""
        assert asynchronous  # noqa: S101 - what the driver must not wait for
        self._arm.begin(motion)

    @property
    def is_in_control(self) -> bool:
        """Whether a motion runs."""
        return self._arm.moving

    def join_motion(self) -> None:
        """Raise why the motion has ended, where it has not come to its end."""
        end, self._arm.end = self._arm.end, ""
        if end:
            raise ControlException(end)


for _each in (NetworkException, ControlException):
    _each.__module__ = "franky"
