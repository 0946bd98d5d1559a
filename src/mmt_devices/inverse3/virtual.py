"""``virtual-inverse3``: drivers of a handle and an arm at an emulated service."""

from collections.abc import Sequence
from typing import Any, Final, TypeVar

from mmt.core.arrays import Vector
from mmt.devices.drivers import Role
from mmt.devices.leader_reports import InterfaceState
from mmt.testing.emulated.drivers import HandleLabOptions, VirtualDevice
from mmt.testing.emulated.lab_process import LabProcess
from mmt_devices.inverse3.driver import Inverse3Handle, Inverse3Robot

AnyDriver = TypeVar("AnyDriver", Inverse3Handle, Inverse3Robot)

_LAB: Final = LabProcess("mmt_devices.inverse3.emulated")


class _VirtualInverse3(VirtualDevice[AnyDriver]):
    """Base of both roles.

    Parameters
    ----------
    role
        Role of the driver.
    options
        Those of ``inverse3`` except `address`, and of `HandleLabOptions`.
    """

    def __init__(self, role: Role, options: dict[str, Any]) -> None:
        super().__init__(
            "virtual-inverse3", "inverse3", role, options,
            role=role, lab=_LAB, lab_options=HandleLabOptions,
        )  # fmt: skip


class VirtualInverse3Handle(_VirtualInverse3[Inverse3Handle]):
    """Handle with which a simulated hand strokes a surface at the scene's zero."""

    def __init__(self, **options: Any) -> None:
        super().__init__("handle", options)

    def read(self, elapsed_ticks: int) -> InterfaceState:
        """Return the state of the real driver."""
        return self._connected().read(elapsed_ticks)

    def write(self, force_n: Vector) -> None:
        """Display a force (N)."""
        self._connected().write(force_n)


class VirtualInverse3Robot(_VirtualInverse3[Inverse3Robot]):
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
        """Return the positions that the real driver has kept."""
        return self._connected().positions(after_ns, until_ns)

    def write(self, position_mm: Vector) -> None:
        """Command a position (mm)."""
        self._connected().write(position_mm)
