"""A Franka arm as the follower's robot, and its estimate of the force at its tip as a sensor."""

import math
import time
from collections import Counter
from collections.abc import Mapping
from functools import partial
from typing import Final, Generic, TypeVar

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, InputError
from mmt.core.extras import require
from mmt.core.quaternions import Quaternion
from mmt.devices.axes import Axes
from mmt.devices.discovery import lacking
from mmt.devices.reading_checks import measured
from mmt_devices.franka.arm import FrankaArm, acquire_arm, release_arm
from mmt_devices.franka.control import PositionControl
from mmt_devices.franka.options import ArmOptions, FrankaRobotOptions

_BIAS_STATES: Final = 200
_BIAS_PATIENCE_S: Final = 5.0
_NO_FORCE: Final = (
    "force of exactly zero, which is what the arm says near a singularity, and what a simulator "
    "without contact says"
)

AnyOptions = TypeVar("AnyOptions", bound=ArmOptions)


missing = lacking(partial(require, "franky"))


class _ArmDriver(Generic[AnyOptions]):
    """Base of both drivers, with their share in the connection."""

    def __init__(self, options: AnyOptions) -> None:
        require("franky")
        self._options = options
        self.arm: FrankaArm | None = None
        self._counts: Counter[str] = Counter()

    def connect(self) -> None:
        """Connect the arm, and recover it if a reflex has stopped it; nothing moves.

        Raises
        ------
        MmtError
            The arm cannot be used; the message says what to do.
        """
        self.close()
        self.arm = acquire_arm(self._options)

    def close(self) -> None:
        """Bring the arm to rest and disconnect it, unless the other driver uses it."""
        arm, self.arm = self.arm, None
        if arm is not None:
            release_arm(arm)

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of survived faults, by kind."""
        return self._counts

    def await_turn(self) -> None:
        """Return soon after the thread that reads the arm has done its turn."""
        self._connected().await_turn()

    def _connected(self) -> FrankaArm:
        if self.arm is None:
            raise DeviceLost(f"the Franka arm {self._options.host} is not connected")
        return self.arm


class FrankaRobot(_ArmDriver[FrankaRobotOptions]):
    """Implements `Robot`; see `docs/how-to/franka.md`."""

    OPTIONS = FrankaRobotOptions

    def __init__(self, options: FrankaRobotOptions) -> None:
        super().__init__(options)
        self._axes = Axes(self._options.axes, self._options.origin_mm)
        self._control: PositionControl | None = None

    def connect(self) -> None:
        """Connect the arm; see `_ArmDriver`."""
        super().connect()
        arm = self._connected()
        if arm.control is not None:
            self.close()
            raise InputError(f"the {arm.name} is driven already: name it once as a robot")
        self._control = arm.control = PositionControl(arm.franky, self._options)

    def close(self) -> None:
        """Bring the arm to rest, and disconnect it unless it is also a force sensor in use."""
        control, self._control = self._control, None
        if self.arm is not None and control is not None:
            self.arm.release()
        super().close()

    def calibrate(self) -> None:
        """Do nothing: the arm is calibrated, and the scene's zero is the option `origin_mm`."""

    def read(self) -> Vector:
        """Return the end effector's position (mm), about a tick old."""
        return self._axes.place_in_scene(self._connected().check().position_mm)

    def orientation(self) -> Quaternion:
        """Return the end effector's orientation (w, x, y, z), about a tick old."""
        return self._axes.turn_in_scene(self._connected().check().orientation)

    def write(self, position_mm: Vector) -> None:
        """Command a position (mm); count and ignore one that is not finite."""
        self._connected().check()
        if not math.isfinite(sum(position_mm)):
            self._counts["commands that are not finite"] += 1
        elif self._control is not None:
            self._control.target_mm = self._axes.place_on_device(position_mm)


class FrankaForce(_ArmDriver[ArmOptions]):
    """Implements `ForceSensor` by the arm's estimate of the external force, `O_F_ext_hat_K`.

    See `docs/how-to/franka.md`.
    """

    OPTIONS = ArmOptions

    def __init__(self, options: ArmOptions) -> None:
        super().__init__(options)
        self._axes = Axes(self._options.axes)
        self._bias_n: Vector = (0.0, 0.0, 0.0)

    def calibrate(self) -> None:
        """Take the mean force of 200 states, 0.2 s, as the bias; the tool is free and at rest.

        Raises
        ------
        DeviceLost
            The arm is lost, or gives too few finite forces.
        """
        arm, until_s = self._connected(), time.monotonic() + _BIAS_PATIENCE_S
        forces: dict[int, Vector] = {}
        while len(forces) < _BIAS_STATES:
            if time.monotonic() > until_s:
                raise DeviceLost(
                    f"the arm gave {len(forces)} finite forces in {_BIAS_PATIENCE_S:g} s "
                    f"for its bias, {_BIAS_STATES} are needed: check it in Desk"
                )
            state = arm.check()
            if (force := measured(state.force_n)) is not None:
                forces[state.time_ms] = force
            time.sleep(0.0005)
        x, y, z = (math.fsum(column) / len(forces) for column in zip(*forces.values(), strict=True))
        self._bias_n = (x, y, z)

    def read(self) -> Vector:
        """Return the force (N) of the touched surface on the tool, without the bias.

        It is zero if the arm tells none.
        """
        x, y, z = self._connected().check().force_n
        if x == y == z == 0.0:
            self._counts[_NO_FORCE] += 1
            return (0.0, 0.0, 0.0)
        a, b, c = self._bias_n
        return self._axes.to_scene((x - a, y - b, z - c))
