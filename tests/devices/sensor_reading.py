"""Read a sensor until something has come, however busy the machine is."""

import time

import numpy as np
import pytest
from waiting import PATIENCE_S, until, until_lost


def read_until(sensor, enough):
    """Read each millisecond until what has come is enough."""
    readings = []
    end = time.monotonic() + PATIENCE_S
    while not enough(readings):
        assert time.monotonic() < end, f"{len(readings)} readings, {dict(sensor.faults)}"
        time.sleep(0.001)
        readings += sensor.read()
    return readings


def read_some(sensor, count=50):
    """Read so many records."""
    return read_until(sensor, lambda readings: len(readings) >= count)


def read_until_fault(sensor, reason, count=1):
    """Read until so many faults of a kind have been counted."""
    before = sensor.faults.get(reason, 0)
    return read_until(sensor, lambda _: sensor.faults.get(reason, 0) >= before + count)


def read_until_lost(sensor, words):
    """Read until the sensor is lost, and says these words."""
    until_lost(sensor.read, words)


def check_times_rise(readings):
    """See that no reading is as old as one before it, or older."""
    times = [reading.time_ns for reading in readings]
    assert times == sorted(set(times))


def until_turned(robot, expected):
    """Wait until a robot's orientation is this one."""
    x, y, z, w = expected.as_quat()
    until(lambda: abs(np.dot(robot.orientation(), (w, x, y, z))) == pytest.approx(1.0, abs=1e-12))
