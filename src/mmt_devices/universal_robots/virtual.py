"""``virtual-ur``: the real drivers, connected to the emulated arm of the virtual lab."""

from typing import Any, ClassVar

from mmt.core.extras import require
from mmt.testing.emulated.drivers import VirtualDevice, forwarded
from mmt_devices.universal_robots.force import UrForceSensor
from mmt_devices.universal_robots.robot import UrRobot, missing

__all__ = ["VirtualUrForceSensor", "VirtualUrRobot", "missing"]


class _VirtualUr(VirtualDevice):
    """A real driver, connected to the lab's controller; takes the options of `LabOptions` too."""

    NAME, DRIVER, ADDRESS = "virtual-ur", "ur", "ur"
    NEEDED: ClassVar = {"host": "lab"}

    def __init__(self, **options: Any) -> None:
        require("rtde_control")  # before a lab is started in vain
        super().__init__(**options)

    def connect(self) -> None:
        """Start the lab, and connect the real driver to it."""
        try:
            super().connect()
        except BaseException:
            self.close()
            raise


class VirtualUrRobot(_VirtualUr):
    """The arm of the virtual lab; it takes the options of ``ur`` and of `LabOptions`."""

    ROLE = "robot"
    read = forwarded(UrRobot.read)
    orientation = forwarded(UrRobot.orientation)
    positions = forwarded(UrRobot.positions)
    write = forwarded(UrRobot.write)


class VirtualUrForceSensor(_VirtualUr):
    """The force at the tool of the virtual lab's arm."""

    ROLE = "force_sensor"
    read = forwarded(UrForceSensor.read)

    def _enter(self) -> dict[str, Any]:
        return {key: value for key, value in super()._enter().items() if key != "origin_mm"}
