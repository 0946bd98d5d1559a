"""Drivers of the emulated arm: the real ones, at the controller of the virtual lab."""

from collections.abc import Mapping, Sequence
from typing import Any, Generic, TypeVar

from mmt.core.errors import DeviceLost, MmtError
from mmt.core.extras import require
from mmt.devices.discovery import missing_package
from mmt.devices.drivers import Role, load_device
from mmt.devices.protocols import Vector
from mmt.testing.emulated.drivers import LAB, LabOptions, check_options, take_lab_options
from mmt_devices.universal_robots.force import UrForceSensor
from mmt_devices.universal_robots.robot import UrRobot

AnyDriver = TypeVar("AnyDriver", UrRobot, UrForceSensor)


def missing() -> str:
    """Return what this machine lacks for the driver, with what to do; empty if nothing."""
    return missing_package("rtde_control")


class _VirtualUr(Generic[AnyDriver]):
    """A real driver at the lab's controller.

    Parameters
    ----------
    role
        Of the driver ``ur``.
    keys
        What the lab tells it.
    options
        Its options, and those of the lab.
    """

    def __init__(self, role: Role, keys: tuple[str, ...], options: dict[str, Any]) -> None:
        self._lab_options = take_lab_options(LabOptions, "virtual-ur", options)
        self._options = options
        require("rtde_control")  # before a lab is begun in vain
        check_options("virtual-ur", "ur", {"host": "lab", **options}, role)
        self._role: Role = role
        self._keys = keys
        self._device: AnyDriver | None = None
        self._connected_to: dict[str, Any] = {}

    def connect(self) -> None:
        """Start the lab, and connect the real driver to it."""
        addresses = LAB.enter(self, *self._lab_options.arguments, "ur")
        try:
            address = _address_of(addresses)
            if self._device is None or address != self._connected_to:
                chosen = {key: address[key] for key in self._keys}
                made: Any = load_device("ur", {**chosen, **self._options}, role=self._role)
                self._device = made
                self._connected_to = address
            self._connected().connect()
        except BaseException:
            self.close()
            raise

    def calibrate(self) -> None:
        """Calibrate the real driver."""
        self._connected().calibrate()

    def read(self) -> Vector:
        """Read the real driver."""
        return self._connected().read()

    def close(self) -> None:
        """Close the real driver and leave the lab; calling it twice is harmless."""
        if self._device is not None:
            self._device.close()
        LAB.leave(self)

    def _connected(self) -> AnyDriver:
        if self._device is None:
            raise DeviceLost("the virtual UR arm is not connected")
        return self._device


def _address_of(addresses: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Return where the arm is, among what a lab has."""
    if "ur" not in addresses:
        raise MmtError(
            "the virtual lab has another robot already: a scene with virtual-ur as force sensor "
            "has it as its robot too"
        )
    return addresses["ur"]


class VirtualUrRobot(_VirtualUr[UrRobot]):
    """The arm of the virtual lab; it takes the options of ``ur`` and of `LabOptions`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("robot", ("host", "origin_mm", "rotation_rad"), options)

    def positions(self, after_ns: int, until_ns: int) -> Sequence[tuple[int, Vector]]:
        """Return what the real driver has kept."""
        return self._connected().positions(after_ns, until_ns)

    def write(self, position_mm: Vector) -> None:
        """Command a position (mm)."""
        self._connected().write(position_mm)

    @property
    def faults(self) -> Mapping[str, int]:
        """Faults of the real driver."""
        return {} if self._device is None else self._device.faults


class VirtualUrForceSensor(_VirtualUr[UrForceSensor]):
    """The force at the tool of that arm."""

    def __init__(self, **options: Any) -> None:
        super().__init__("force_sensor", ("host", "rotation_rad"), options)
