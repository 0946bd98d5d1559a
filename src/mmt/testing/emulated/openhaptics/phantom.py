"""Virtual Phantoms of leader and follower: the real driver on the emulated HD library.

The follower's tip meets the library's wall. It reports its position to the lab, and the lab's
surface makes force and vibration for the emulated sensors. The leader's tip is held by a simulated
hand, as by a spring.
"""

import math
import select
import socket
import struct
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.arrays import Vector
from mmt.devices.openhaptics.handle import OpenHapticsHandle
from mmt.devices.openhaptics.options import HdOptions, HdRobotOptions
from mmt.devices.openhaptics.robot import OpenHapticsRobot
from mmt.testing.emulated.drivers import LAB, HandleLabOptions, LabOptions
from mmt.testing.emulated.openhaptics.hd import EmulatedHd
from mmt.testing.simulation import START_MM
from mmt.testing.simulation.robot import TipState

if TYPE_CHECKING:
    from mmt.testing.emulated import Clockwork
    from mmt.testing.emulated.lab import World

WALL_N_MM: Final = 2.0
"""Stiffness of the surface."""
ROBOT_N_MM: Final = float(HdRobotOptions.model_fields["stiffness_n_mm"].default)
_GRIP_N_MM: Final = 1.0
_PERIOD_S: Final = 0.001
_COURSE_S: Final = 120.0
_HALF_MM: Final = 45.0
_UP_MM: Final = 4.0
_TIP: Final = struct.Struct("<6d")
_KEPT: Final = 500_000


def series_n_mm(robot_n_mm: float = ROBOT_N_MM) -> float:
    """Return the force over the depth of the command: robot and surface in series (N/mm)."""
    return 1.0 / (1.0 / WALL_N_MM + 1.0 / robot_n_mm)


def brushing_mm(seed: int) -> list[Vector]:
    """Return the intended path of a hand that brushes a surface: it lands and lifts in its strokes.

    One position each millisecond, for `_COURSE_S`. The hand strokes to and fro over 90 mm at 30 to
    270 mm/s in the middle, is down for 0.5 to 1.5 s with 0.3 to 2.5 N (on a robot of
    `ROBOT_N_MM`), and up by 4 mm for 0.3 to 0.6 s.
    """
    random = np.random.default_rng(seed)
    count = round(_COURSE_S / _PERIOD_S)
    knots = np.arange(0.0, _COURSE_S + 1.0, 1.0)
    now_s = np.arange(count) * _PERIOD_S
    speed = np.interp(now_s, knots, random.uniform(30.0, 270.0, len(knots)))
    force = np.interp(now_s, knots, random.uniform(0.3, 2.5, len(knots)))
    way = np.cumsum(speed) * _PERIOD_S / _HALF_MM
    down, at_s = np.zeros(count), 1.0
    while at_s < _COURSE_S - 3.0:
        lands_s, stays_s = random.uniform(0.06, 0.15), random.uniform(0.5, 1.5)
        share = np.clip((now_s - at_s) / lands_s, 0.0, 1.0)
        share -= np.clip((now_s - at_s - lands_s - stays_s) / lands_s, 0.0, 1.0)
        down += 0.5 - 0.5 * np.cos(np.pi * share)
        at_s += 2.0 * lands_s + stays_s + random.uniform(0.3, 0.6)
    depth = (1.0 / series_n_mm() + 1.0 / _GRIP_N_MM) * force
    height = _UP_MM - down * (_UP_MM + depth)
    places = np.column_stack([_HALF_MM * np.sin(way), 10.0 * np.sin(0.2 * way), height])
    return [(x, y, z) for x, y, z in places.tolist()]


class ReportedTip:
    """A tip in another process that reports its state; it meets a wall at zero, with friction."""

    def __init__(self) -> None:
        self.friction_coefficient = 0.0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._state = (*START_MM, 0.0, 0.0, 0.0)

    @property
    def options(self) -> dict[str, Any]:
        """Port that receives the reports."""
        return {"port": self._socket.getsockname()[1]}

    def start(self) -> None:
        """Do nothing: the world asks it."""

    def stop(self) -> None:
        """Close the port."""
        self._socket.close()

    def advance(self, command_mm: Vector) -> TipState:  # noqa: ARG002 - it is moved elsewhere
        """Return the last reported state, and the force there."""
        while select.select([self._socket], [], [], 0.0)[0]:
            packet = self._socket.recv(64)
            if len(packet) == _TIP.size:
                self._state = _TIP.unpack(packet)
        x, y, z, u, v, w = self._state
        normal = WALL_N_MM * max(-z, 0.0)
        friction = self.friction_coefficient * normal / max(math.hypot(u, v), 1.0)
        return TipState((x, y, z), (u, v, w), (-friction * u, -friction * v, normal), (0.0,) * 3)


def in_lab(world: "World", seed: int, clockwork: "Clockwork") -> ReportedTip:
    """Return the tip of the lab, which stands on the world's surface."""
    _ = seed, clockwork
    tip = ReportedTip()
    world.place_tip(tip)
    return tip


class VirtualPhantomRobotOptions(HdRobotOptions, LabOptions):
    """Options of the robot, and of its lab."""


class VirtualPhantomRobot(OpenHapticsRobot):
    """The driver ``openhaptics`` on the emulated library."""

    OPTIONS = VirtualPhantomRobotOptions

    def __init__(self, options: VirtualPhantomRobotOptions) -> None:
        self._lab, self._emulated = options.arguments, EmulatedHd()
        super().__init__(options.model_copy(update={"library": self._emulated.address}))
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def connect(self) -> None:
        """Start the lab and the library, and report the library's tip to the lab."""
        self.close()
        port = LAB.address(self, "phantom", *self._lab)["port"]
        self._emulated.start()
        self._emulated.place(self._axes.place_on_device(START_MM))
        wall_mm = self._axes.place_on_device((0.0, 0.0, 0.0))[1]
        self._emulated.wall(wall_mm, WALL_N_MM)
        self._ended.clear()
        self._thread = threading.Thread(target=self._tell, args=(port,), daemon=True)
        self._thread.start()
        super().connect()

    def close(self) -> None:
        """Leave the lab and stop the library; calling it twice is harmless."""
        super().close()
        if self._thread is not None:
            self._ended.set()
            self._thread.join()
            self._thread = None
            self._emulated.stop()
            LAB.release(self)

    def _tell(self, port: int) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
            while not self._ended.wait(_PERIOD_S):
                seen = self._emulated.tip_state()
                place = self._axes.place_in_scene(seen.position_mm)
                speed = self._axes.to_scene(seen.velocity_mm_s)
                outlet.sendto(_TIP.pack(*place, *speed), ("127.0.0.1", port))


class VirtualPhantomHandleOptions(HdOptions, HandleLabOptions):
    """Options of the handle, and of its lab."""

    log: Path | None = None
    """File to which the tip's path is written on `close`."""


class VirtualPhantomHandle(OpenHapticsHandle):
    """The driver ``openhaptics`` on the emulated library, its tip held by a simulated hand."""

    OPTIONS = VirtualPhantomHandleOptions

    def __init__(self, options: VirtualPhantomHandleOptions) -> None:
        self._emulated = EmulatedHd(self._held_at, hand_n_mm=_GRIP_N_MM)
        super().__init__(options.model_copy(update={"library": self._emulated.address}))
        self._wanted_mm = brushing_mm(options.seed)
        self._begun_ns: int | None = None
        self._log = options.log
        self._way: list[tuple[float, ...]] = []

    def connect(self) -> None:
        """Start the library and let the hand move."""
        self._emulated.start()
        super().connect()

    def close(self) -> None:
        """Release the device and write the log; calling it twice is harmless."""
        super().close()
        self._emulated.stop()
        if self._log is not None and self._way:
            np.savez(self._log, way=np.array(self._way))
            self._log = None

    def _held_at(self, time_ns: int) -> Vector:
        """Return the place at which the hand holds the tip, in the device's axes; log the tip."""
        if self._begun_ns is None:
            self._begun_ns = time_ns
        if self._log is not None and len(self._way) < _KEPT:
            seen = self._emulated.tip_state()
            now_s = 1e-9 * time.monotonic_ns()
            where = self._axes.place_in_scene(seen.position_mm)
            self._way.append((now_s, *where, *self._axes.to_scene(seen.velocity_mm_s)))
        place = round(1e-6 * (time_ns - self._begun_ns)) % len(self._wanted_mm)
        return self._axes.place_on_device(self._wanted_mm[place])
