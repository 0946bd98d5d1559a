"""``virtual-inverse3``: drivers of a handle and an arm at an emulated service."""

from collections.abc import Sequence
from typing import Any, Final

from mmt.core.arrays import Vector
from mmt.devices.leader_reports import InterfaceState
from mmt.testing.emulated.drivers import HandleLabOptions, VirtualDevice
from mmt.testing.emulated.lab_process import LabProcess
from mmt_devices.inverse3.driver import Inverse3Handle, Inverse3Robot

_LAB: Final = LabProcess("mmt_devices.inverse3.emulated")


class VirtualInverse3Handle(VirtualDevice[Inverse3Handle]):
    """Handle with which a simulated hand strokes a surface at the scene's zero.

    Parameters
    ----------
    **options
        Those of ``inverse3`` except `address`, and of `HandleLabOptions`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(
            "virtual-inverse3", "inverse3", "handle", options,
            role="handle", lab=_LAB, lab_options=HandleLabOptions,
        )  # fmt: skip

    def read(self, elapsed_ticks: int) -> InterfaceState:
        """Return the state of the real driver."""
        return self._connected().read(elapsed_ticks)

    def write(self, force_n: Vector) -> None:
        """Display a force (N)."""
        self._connected().write(force_n)


class VirtualInverse3Robot(VirtualDevice[Inverse3Robot]):
    """An arm with a free tip, in the air; options as for `VirtualInverse3Handle`."""

    def __init__(self, **options: Any) -> None:
        super().__init__(
            "virtual-inverse3", "inverse3", "robot", options,
            role="robot", lab=_LAB, lab_options=HandleLabOptions,
        )  # fmt: skip

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
