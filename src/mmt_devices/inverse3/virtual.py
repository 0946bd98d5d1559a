"""``virtual-inverse3``: drivers of a handle and an arm at an emulated service."""

from typing import Any, Final

from mmt.testing.emulated.drivers import HandleLabOptions, VirtualDevice, forwarded
from mmt.testing.emulated.lab_process import LabProcess
from mmt_devices.inverse3.driver import Inverse3Handle, Inverse3Robot

_LAB: Final = LabProcess("mmt_devices.inverse3.emulated")


class VirtualInverse3Handle(VirtualDevice):
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

    read = forwarded(Inverse3Handle.read)
    write = forwarded(Inverse3Handle.write)


class VirtualInverse3Robot(VirtualDevice):
    """An arm with a free tip, in the air; options as for `VirtualInverse3Handle`."""

    def __init__(self, **options: Any) -> None:
        super().__init__(
            "virtual-inverse3", "inverse3", "robot", options,
            role="robot", lab=_LAB, lab_options=HandleLabOptions,
        )  # fmt: skip

    await_turn = forwarded(Inverse3Robot.await_turn)
    read = forwarded(Inverse3Robot.read)
    positions = forwarded(Inverse3Robot.positions)
    write = forwarded(Inverse3Robot.write)
