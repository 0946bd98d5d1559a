"""Accelerometers of industrial I/O in software for a test, and drivers for them."""

import sys

import pytest

from mmt.devices.adxl335.gravity import GRAVITY_M_S2
from mmt.devices.drivers import load_device

if sys.platform != "linux":
    pytest.skip("industrial I/O is a part of Linux", allow_module_level=True)

from mmt_devices.iio.emulated import EmulatedIio
from mmt_devices.iio.emulated_chips import ADXL345

LEVEL = (0.5, -0.25, GRAVITY_M_S2)


@pytest.fixture(name="emulated")
def emulated_iio(started):
    """One that is there."""
    return started(EmulatedIio(lambda _time_ns: LEVEL))


@pytest.fixture(name="adxl345")
def emulated_adxl345(started):
    """One without stamps and triggers."""
    return started(EmulatedIio(lambda _time_ns: LEVEL, ADXL345))


@pytest.fixture(name="drivers")
def iio_drivers(closing):
    """Makes drivers of emulated ones, which are closed at the end."""
    return lambda emulated, **more: closing(
        load_device("iio-accelerometer", {**emulated.options, **more})
    )
