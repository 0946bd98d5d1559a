"""Accelerometers of industrial I/O in software for a test, and drivers for them."""

import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from mmt.devices.adxl335.gravity import GRAVITY_M_S2
from mmt.devices.drivers import load_device
from mmt_devices.iio.driver import IioAccelerometer

if sys.platform != "linux":
    pytest.skip("industrial I/O is a part of Linux", allow_module_level=True)

from mmt_devices.iio.emulated import EmulatedIio
from mmt_devices.iio.emulated_chips import ADXL345

LEVEL = (0.5, -0.25, GRAVITY_M_S2)

Drivers = Callable[..., IioAccelerometer]


@pytest.fixture(name="emulated")
def emulated_iio() -> Iterator[EmulatedIio]:
    """One that is there."""
    made = EmulatedIio(lambda _time_ns: LEVEL)
    made.start()
    yield made
    made.stop()


@pytest.fixture(name="adxl345")
def emulated_adxl345() -> Iterator[EmulatedIio]:
    """One without stamps and triggers."""
    made = EmulatedIio(lambda _time_ns: LEVEL, ADXL345)
    made.start()
    yield made
    made.stop()


@pytest.fixture(name="drivers")
def iio_drivers() -> Iterator[Drivers]:
    """Makes drivers of emulated ones, and closes them."""
    made: list[IioAccelerometer] = []

    def make(emulated: EmulatedIio, **options: Any) -> IioAccelerometer:
        sensor = load_device("iio-accelerometer", {**emulated.options, **options})
        made.append(sensor)
        return sensor

    yield make
    for sensor in made:
        sensor.close()
