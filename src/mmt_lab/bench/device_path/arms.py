"""The emulated arms and a handle, in a process of their own.

It prints the options of the driver as one line of JSON. ``begin`` lets the tip turn, and
``commands`` is answered by what the driver has sent, and when (ns); it ends when its input ends.
"""

import sys
import time
from collections.abc import Callable
from typing import Any, Final

from mmt.core.process import prefer_even_ticks, wake_on_time
from mmt.devices.protocols import Vector
from mmt.testing.emulated.robot import RobotLink
from mmt_devices.inverse3.emulated import REST_MM, EmulatedInverse3
from mmt_devices.inverse3.emulated_tip import EmulatedTip
from mmt_devices.universal_robots.emulated.arm import SERVO_LINEAR
from mmt_devices.universal_robots.emulated.controller import EmulatedUrController
from mmt_devices.universal_robots.frame import M_TO_MM
from mmt_lab.bench.device_path.children import say
from mmt_lab.bench.device_path.emulated import be_real_time_device, leave_a_processor_to_others
from mmt_lab.bench.device_path.frame_times import Motion

_SIZE_MM: Final = 4.0
"""At its speed of 0.5 m/s no driver takes the tip's motion for a fault."""


class _Heard:
    """The commands that differ from the one before, and when they came (ns)."""

    def __init__(self) -> None:
        self.times_ns: list[int] = []
        self.values: list[Vector] = []

    def note(self, value: Vector) -> None:
        """Take a command."""
        if not self.values or value != self.values[-1]:
            self.times_ns.append(time.monotonic_ns())
            self.values.append(value)


class _DatagramTip:
    """A tip behind datagrams; where it is sent changes nothing."""

    def __init__(self, motion: Motion, heard: _Heard) -> None:
        self.position_mm = motion
        self._heard = heard

    @property
    def command_mm(self) -> Vector | None:
        """The newest command."""
        return self._heard.values[-1] if self._heard.values else None

    @command_mm.setter
    def command_mm(self, value: Vector | None) -> None:
        if value is not None:
            self._heard.note(value)


class _UrTip:
    """A tip of a UR arm that touches nothing; where it is sent changes nothing."""

    command_mm: Vector | None = None

    def __init__(self, motion: Motion) -> None:
        self.position_mm = motion

    def force_n(self, time_ns: int) -> Vector:  # noqa: ARG002 - it is always the same
        """Return the force on it."""
        return (0.0, 0.0, 0.0)


class _UrController(EmulatedUrController):
    """A controller that notes where its arm is sent, as soon as it is told."""

    def __init__(self, motion: Motion, heard: _Heard) -> None:
        super().__init__(_UrTip(motion))
        self._heard = heard

    def take(self, values: dict[str, Any]) -> None:
        """Take input registers."""
        if values.get("input_int_register_0") == SERVO_LINEAR:
            x, y, z = (M_TO_MM * values[f"input_double_register_{i}"] for i in range(3))
            self._heard.note((x, y, z))
        super().take(values)


class _InverseTip(EmulatedTip):
    """The tip of an Inverse3; neither place nor force that is commanded changes where it is."""

    def __init__(self, motion: Motion, heard: _Heard) -> None:
        super().__init__(REST_MM)
        self._motion, self._heard = motion, heard

    def command_position(self, position_mm: Vector, now_ns: int) -> None:
        """Note a place."""
        self._heard.note(position_mm)
        super().command_position(position_mm, now_ns)

    def command_force(self, force_n: Vector, now_ns: int) -> None:
        """Note a force."""
        self._heard.note(force_n)
        super().command_force(force_n, now_ns)

    def advance(self, now_ns: int) -> None:
        """Turn, whatever is commanded."""
        (x, y, z), (u, v, w) = self._motion(now_ns), REST_MM
        self.place((x + u, y + v, z + w))


def _inverse3(motion: Motion, heard: _Heard) -> EmulatedInverse3:
    return EmulatedInverse3({"049D": _InverseTip(motion, heard)})


DEVICES: Final[dict[str, Callable[[Motion, _Heard], Any]]] = {
    "datagrams": lambda motion, heard: RobotLink(_DatagramTip(motion, heard)),
    "ur": _UrController,
    "inverse3": _inverse3,
    "inverse3_handle": _inverse3,
}
"""Makes the emulated device, by the names of `mmt_lab.bench.device_path.arm_times`."""


def main(name: str, scheduling: str) -> None:
    """Run the device until standard input ends."""
    prefer_even_ticks()
    leave_a_processor_to_others()
    wake_on_time()
    be_real_time_device(scheduling)
    motion, heard = Motion(_SIZE_MM), _Heard()
    device = DEVICES[name](motion, heard)
    device.start()
    say(device.options)
    for line in sys.stdin:
        if line.strip() == "begin":
            motion.begin()
            say({"done_ns": time.monotonic_ns()})
        else:
            say({"times_ns": heard.times_ns, "values": heard.values})
    device.stop()


if __name__ == "__main__":
    main(*sys.argv[1:])
