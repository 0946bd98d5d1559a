"""``virtual-inverse3``: drivers of a handle and an arm at an emulated service."""

from mmt.testing.emulated.drivers import HandleLabOptions, VirtualDevice, forwarded
from mmt.testing.emulated.lab_process import LabProcess
from mmt_devices.inverse3.driver import Inverse3Handle, Inverse3Robot


class _VirtualInverse3(VirtualDevice):
    """A driver of an Inverse3, at an emulated service.

    Parameters
    ----------
    **options
        Those of ``inverse3`` except `address`, and of `HandleLabOptions`.
    """

    NAME, DRIVER = "virtual-inverse3", "inverse3"
    PROCESS, LAB_OPTIONS = LabProcess("mmt_devices.inverse3.emulated"), HandleLabOptions


class VirtualInverse3Handle(_VirtualInverse3):
    """Handle with which a simulated hand strokes a surface at the scene's zero."""

    ROLE = ADDRESS = "handle"
    read = forwarded(Inverse3Handle.read)
    write = forwarded(Inverse3Handle.write)


class VirtualInverse3Robot(_VirtualInverse3):
    """An arm with a free tip, in the air."""

    ROLE = ADDRESS = "robot"
    await_turn = forwarded(Inverse3Robot.await_turn)
    read = forwarded(Inverse3Robot.read)
    positions = forwarded(Inverse3Robot.positions)
    write = forwarded(Inverse3Robot.write)
