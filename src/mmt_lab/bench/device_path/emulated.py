"""Process of the emulated devices.

The process first sends the drivers of the devices and their options. It then obeys the commands
``begin``, ``stall SENSOR`` and ``resume SENSOR``, and answers each with the monotonic time (ns) at
which it was done. It ends when the pipe is closed.
"""

import math
import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Final

from mmt.core.arrays import Vector
from mmt.core.running.process import PRIORITY, prefer_even_ticks, wake_on_time
from mmt.core.units import GRAVITY_M_S2
from mmt.devices.adxl335.gravity import nominal
from mmt.testing.emulated.adxl335_board import EmulatedAdxl335Board
from mmt.testing.emulated.digital_ft import EmulatedDigitalFt
from mmt.testing.emulated.labjack_u6 import EmulatedU6, EmulatedU6Voltages
from mmt.testing.emulated.net_ft import EmulatedNetFt
from mmt.testing.emulated.remote_u6 import U6Server
from mmt.testing.emulated.robot import RobotLink
from mmt_devices.bota.emulated import EmulatedBota
from mmt_devices.iio.emulated import EmulatedIio
from mmt_lab.bench.device_path.frame_times import Motion

FORCE_PPM: Final = 40.0
ACCELERATION_PPM: Final = -70.0
"""How much the clock of the force sensor or the accelerometer runs fast, in ppm."""

RATE_HZ: Final = 2000.0
"""Sampling rate of the accelerometer."""
_BANDWIDTH_HZ: Final = 1000.0
_BITS: Final = 16
_SUPPLY_V: Final = 3.3
_STILL: Final = {"stuck_s": 60.0}
"""Options of an accelerometer without noise, whose value does not change at rest."""


@dataclass(frozen=True)
class Emulated:
    """One device of the lab."""

    device: Any
    driver: str
    options: dict[str, Any]
    """Options of its driver."""
    stall: Callable[[bool], None]


Build = Callable[[Motion], Emulated]
"""Builds a device that measures a motion; a function of this module."""


@dataclass
class _Tip:
    """Tip of the emulated arm, which follows a motion."""

    position_mm: Motion
    command_mm: Vector | None = None


def started(device: Any, driver: str, **options: Any) -> Emulated:
    """Start a device and return it, with further options of its driver."""
    device.start()
    return Emulated(
        device, driver, {**device.options, **options}, lambda on: device.stall(silent=on)
    )


def net_ft(truth: Motion) -> Emulated:
    """Return a Net F/T box without its filter and almost without noise."""
    box = EmulatedNetFt(truth, clock_ppm=FORCE_PPM, noise_n=1e-5)
    return started(box, "ati-net-ft", filter=0)


def digital_ft(truth: Motion) -> Emulated:
    """Return a Digital F/T at its full baud rate."""
    sensor = EmulatedDigitalFt(truth, clock_ppm=FORCE_PPM, noise_counts=0.1)
    return started(sensor, "ati-digital-ft")


def adxl335(truth: Motion) -> Emulated:
    """Return an accelerometer's board on a serial port."""
    board = EmulatedAdxl335Board(
        truth,
        rate_hz=RATE_HZ,
        resolution_bits=_BITS,
        bandwidth_hz=_BANDWIDTH_HZ,
        clock_ppm=ACCELERATION_PPM,
        noise_density=0.0,
    )
    return started(board, "adxl335-serial", resolution_bits=_BITS, **_STILL)


def bota(truth: Motion) -> Emulated:
    """Return a serial sensor by Bota Systems."""
    return started(EmulatedBota(truth, clock_ppm=FORCE_PPM, noise_n=1e-5), "bota-serial")


def iio(truth: Motion) -> Emulated:
    """Return an accelerometer of industrial I/O."""
    device = EmulatedIio(truth, clock_ppm=ACCELERATION_PPM, noise_m_s2=0.0)
    return started(device, "iio-accelerometer", **_STILL)


def u6(truth: Motion) -> Emulated:
    """Return an accelerometer at a LabJack U6."""
    calibration = nominal(_SUPPLY_V)
    delay_ns = round(1e9 / (math.tau * _BANDWIDTH_HZ))

    def volts(time_ns: int) -> list[float]:
        felt = truth(time_ns - delay_ns)
        axes = zip(calibration.zero_v, calibration.gain_v_per_m_s2, felt, strict=True)
        return [zero + gain * value for zero, gain, value in axes] + [0.0] * 11

    box = EmulatedU6(volts, clock_ppm=ACCELERATION_PPM)
    server = U6Server(box)
    server.start()
    board = {
        "driver": f"{EmulatedU6Voltages.__module__}:{EmulatedU6Voltages.__name__}",
        "inputs": [0, 1, 2],
        "rate_hz": RATE_HZ,
        "address": server.address,
    }
    options = {"board": board, "bandwidth_hz": _BANDWIDTH_HZ, **_STILL}
    return Emulated(server, "adxl335-board", options, lambda on: box.stall(silent=on))


def leave_a_processor_to_others() -> None:
    """Run on all processors but the first: real devices take none of the follower's time.

    If there is only one processor, or the system has no CPU affinity, nothing changes.
    """
    if hasattr(os, "sched_setaffinity"):
        _, *others = sorted(os.sched_getaffinity(0))
        if others:
            os.sched_setaffinity(0, others)


def emulate(pipe: Connection, force: Build, acceleration: Build, realtime: bool) -> None:
    """Run the emulated devices until the pipe is closed."""
    prefer_even_ticks()
    leave_a_processor_to_others()
    wake_on_time()
    if realtime:  # threads inherit this, so that no device waits for other work
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY - 1))
    motions = (Motion(10.0), Motion(5.0), Motion(20.0, (0.0, 0.0, GRAVITY_M_S2)))
    devices = {
        "robot": started(RobotLink(_Tip(motions[0])), "datagrams"),
        "force_sensor": force(motions[1]),
        "accelerometer": acceleration(motions[2]),
    }
    pipe.send({key: {"driver": one.driver, "options": one.options} for key, one in devices.items()})
    with suppress(EOFError):
        while True:
            word, _, sensor = pipe.recv().partition(" ")
            if word == "begin":
                for motion in motions:
                    motion.begin()
            else:
                devices[sensor].stall(word == "stall")
            pipe.send(time.monotonic_ns())
    for one in devices.values():
        one.device.stop()
