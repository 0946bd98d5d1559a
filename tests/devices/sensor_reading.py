"""Read a sensor until something has come, however busy the machine is."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from waiting import PATIENCE_S, until, until_lost

from mmt.devices.protocols import SampledSensor, SensorReading


def read_until(
    sensor: SampledSensor, enough: Callable[[Sequence[SensorReading]], Any]
) -> list[SensorReading]:
    """Read each millisecond until what has come is enough."""
    readings: list[SensorReading] = []
    end = time.monotonic() + PATIENCE_S
    while not enough(readings):
        assert time.monotonic() < end, f"{len(readings)} readings, {dict(sensor.faults)}"
        time.sleep(0.001)
        readings += sensor.read()
    return readings


def read_some(sensor: SampledSensor, count: int = 50) -> list[SensorReading]:
    """Read so many records."""
    return read_until(sensor, lambda readings: len(readings) >= count)


def read_until_fault(sensor: SampledSensor, reason: str, count: int = 1) -> list[SensorReading]:
    """Read until so many faults of a kind have been counted."""
    before = sensor.faults.get(reason, 0)
    return read_until(sensor, lambda _: sensor.faults.get(reason, 0) >= before + count)


def read_until_lost(sensor: SampledSensor, words: str) -> None:
    """Read until the sensor is lost, and says these words."""
    until_lost(sensor.read, words)


def check_times_rise(readings: Sequence[SensorReading]) -> None:
    """See that no reading is as old as one before it, or older."""
    times = [reading.time_ns for reading in readings]
    assert times == sorted(set(times))


def until_turned(robot: Any, expected: Rotation) -> None:
    """Wait until a robot's orientation is this one."""
    x, y, z, w = expected.as_quat()
    until(lambda: abs(np.dot(robot.orientation(), (w, x, y, z))) == pytest.approx(1.0, abs=1e-12))
