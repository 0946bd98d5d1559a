"""``virtual-ur``: the real drivers, connected to the emulated arm of the virtual lab."""

from collections.abc import Sequence
from typing import Any, TypeVar

from mmt.core.arrays import Vector
from mmt.core.extras import require
from mmt.core.quaternions import Quaternion
from mmt.devices.drivers import Role
from mmt.testing.emulated.drivers import VirtualDevice
from mmt_devices.universal_robots.force import UrForceSensor
from mmt_devices.universal_robots.robot import UrRobot, missing

__all__ = ["VirtualUrForceSensor", "VirtualUrRobot", "missing"]

AnyDriver = TypeVar("AnyDriver", UrRobot, UrForceSensor)


class _VirtualUr(VirtualDevice[AnyDriver]):
    """A real driver, connected to the lab's controller.

    Parameters
    ----------
    role
        Role of the driver ``ur``.
    options
        Options of the driver, and those of the lab.
    """

    def __init__(self, role: Role, options: dict[str, Any]) -> None:
        require("rtde_control")  # before a lab is started in vain
        super().__init__("virtual-ur", "ur", "ur", options, role=role, host="lab")

    def connect(self) -> None:
        """Start the lab, and connect the real driver to it."""
        try:
            super().connect()
        except BaseException:
            self.close()
            raise

    def read(self) -> Vector:
        """Return the value that the real driver reads."""
        return self._connected().read()


class VirtualUrRobot(_VirtualUr[UrRobot]):
    """The arm of the virtual lab; it takes the options of ``ur`` and of `LabOptions`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("robot", options)

    def orientation(self) -> Quaternion:
        """Return the orientation that the real driver reads."""
        return self._connected().orientation()

    def positions(self, after_ns: int, until_ns: int) -> Sequence[tuple[int, Vector]]:
        """Return the positions that the real driver has kept."""
        return self._connected().positions(after_ns, until_ns)

    def write(self, position_mm: Vector) -> None:
        """Command a position (mm)."""
        self._connected().write(position_mm)


class VirtualUrForceSensor(_VirtualUr[UrForceSensor]):
    """The force at the tool of the virtual lab's arm."""

    def __init__(self, **options: Any) -> None:
        super().__init__("force_sensor", options)

    def _enter(self) -> dict[str, Any]:
        return {key: value for key, value in super()._enter().items() if key != "origin_mm"}
