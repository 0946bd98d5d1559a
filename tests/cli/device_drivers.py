"""Devices for the tests of `mmt device`, which load them by this module's name."""

import math
import time
from typing import ClassVar

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.protocols import InterfaceState, SensorReading, VoltageReading


class Bare:
    """No device at all."""


class Useless:
    def connect(self):
        pass

    def close(self):
        pass


class Sensor(Useless):
    def read(self):
        return (0.0, 0.0, 9.81)


def made_sensor() -> Sensor:
    return Sensor()


class Actuator(Useless):
    def write(self, samples):
        assert not any(samples)

    def calibrate(self):
        pass


class Polled:
    def __init__(self, z=9.81, absent=False):
        self.z, self.absent, self.closed = z, absent, 0

    def connect(self):
        if self.absent:
            raise MmtError("the box does not answer at 192.168.1.1: is it switched on?")

    def calibrate(self):
        self.z = 0.0

    def read(self):
        return (0.0, 0.0, self.z)

    def write(self, position_mm):
        raise AssertionError("it must not be moved")

    def close(self):
        self.closed += 1


class Sampled(Polled):
    latency_ns = 200_000

    def __init__(self, rate_hz=2000, noise=1.0, silent=False, at_once=1, lost_after=None, **faults):
        super().__init__()
        self.rate_hz, self.noise, self.silent, self.at_once = rate_hz, noise, silent, at_once
        self.lost_after, self.faults = lost_after, faults
        self.given = 0

    def connect(self):
        self.begun_ns = time.monotonic_ns()

    def read(self):
        due = int((time.monotonic_ns() - self.begun_ns) * self.rate_hz / 1e9)
        if self.lost_after is not None and due > self.lost_after:
            raise DeviceLost("unplugged")
        if self.silent:
            return None
        due -= due % self.at_once
        come = [
            SensorReading(round(k * 1e9 / self.rate_hz), (0.0, self.noise * math.sin(k), 9.81))
            for k in range(self.given, due)
        ]
        self.given = max(due, self.given)
        return come or None


class Handle(Polled):
    def read(self, elapsed_ticks):
        return InterfaceState((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.0, False)


class Board(Polled):
    latency_ns = 0
    faults: ClassVar = {}

    def read(self):
        return [VoltageReading(time.monotonic_ns(), (0.1, 0.2, 0.3, 0.4))]
