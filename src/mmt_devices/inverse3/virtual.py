"""The driver of an Inverse3 at an emulated service: a handle that a hand strokes with, an arm."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, Generic, TypeVar

from mmt.core.errors import DeviceLost
from mmt.devices.drivers import Role, load_device
from mmt.devices.protocols import InterfaceState, Vector
from mmt.testing.emulated.drivers import HandleLabOptions, check_options, take_lab_options
from mmt.testing.emulated.lab_process import LabProcess
from mmt_devices.inverse3.handle import Inverse3Handle
from mmt_devices.inverse3.robot import Inverse3Robot

AnyDriver = TypeVar("AnyDriver", Inverse3Handle, Inverse3Robot)

_LABS: Final[dict[Role, LabProcess]] = {
    role: LabProcess("mmt_devices.inverse3.emulated_lab") for role in ("handle", "robot")
}


class VirtualInverse3(Generic[AnyDriver]):
    """What both roles share.

    Parameters
    ----------
    role
        Whose driver it is.
    options
        Those of ``inverse3`` but `address`, and of `HandleLabOptions`.
    """

    def __init__(self, role: Role, options: dict[str, Any]) -> None:
        self._role: Role = role
        self._lab = _LABS[role]
        self._lab_options = take_lab_options(HandleLabOptions, "virtual-inverse3", options)
        self._options = options
        check_options("virtual-inverse3", "inverse3", options, role)
        self._device: AnyDriver | None = None
        self._connected_to: dict[str, Any] = {}

    def connect(self) -> None:
        """Start the lab, and connect the real driver to it."""
        address = self._lab.enter(self, self._role, *self._lab_options.arguments)["inverse3"]
        if self._device is None or address != self._connected_to:
            made: Any = load_device("inverse3", {**address, **self._options}, role=self._role)
            self._device = made
            self._connected_to = address
        self._connected().connect()

    def calibrate(self) -> None:
        """Calibrate the real driver."""
        self._connected().calibrate()

    def close(self) -> None:
        """Close the real driver and leave the lab; calling it twice is harmless."""
        if self._device is not None:
            self._device.close()
        self._lab.leave(self)

    @property
    def faults(self) -> Mapping[str, int]:
        """Faults of the real driver."""
        return {} if self._device is None else self._device.faults

    def remarks(self) -> Sequence[str]:
        """Remarks of the real driver."""
        return [] if self._device is None else self._device.remarks()

    def _connected(self) -> AnyDriver:
        if self._device is None:
            raise DeviceLost("the virtual Inverse3 is not connected")
        return self._device


class VirtualInverse3Handle(VirtualInverse3[Inverse3Handle]):
    """A handle that a simulated hand strokes a surface with, at the scene's zero."""

    def __init__(self, **options: Any) -> None:
        super().__init__("handle", options)

    def read(self, elapsed_ticks: int) -> InterfaceState:
        """Read the real driver."""
        return self._connected().read(elapsed_ticks)

    def write(self, force_n: Vector) -> None:
        """Display a force (N)."""
        self._connected().write(force_n)


class VirtualInverse3Robot(VirtualInverse3[Inverse3Robot]):
    """An arm with a free tip, in the air."""

    def __init__(self, **options: Any) -> None:
        super().__init__("robot", options)

    def await_turn(self) -> None:
        """Wait for the real driver."""
        self._connected().await_turn()

    def read(self) -> Vector:
        """Return the newest position (mm)."""
        return self._connected().read()

    def positions(self, after_ns: int, until_ns: int) -> Sequence[tuple[int, Vector]]:
        """Return what the real driver has kept."""
        return self._connected().positions(after_ns, until_ns)

    def write(self, position_mm: Vector) -> None:
        """Command a position (mm)."""
        self._connected().write(position_mm)
