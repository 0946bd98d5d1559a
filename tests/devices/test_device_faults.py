"""Faults of a real driver on its emulated device while frames are formed of it."""

import itertools
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from driver_fixtures import own_calibrations  # noqa: F401 - a fixture
from running_source import RunningSource
from sensor_reading import read_some, read_until_lost
from waiting import check_refused

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost
from mmt.devices.adxl335.gravity import GRAVITY_M_S2
from mmt.devices.drivers import load_device
from mmt.testing.emulated.net_ft import EmulatedNetFt

if sys.platform != "linux":
    pytest.skip("the emulated ports are for Linux", allow_module_level=True)

from mmt.testing.emulated.adxl335_board import EmulatedAdxl335Board
from mmt.testing.emulated.digital_ft import EmulatedDigitalFt
from mmt_devices.bota.emulated import EmulatedBota
from mmt_devices.bota.frames import INVALID
from mmt_devices.iio.emulated import EmulatedIio

PRESSED = (0.0, 0.0, 2.0)


class Felt:
    """What the emulated device measures; it changes while the device is lost."""

    value: Vector = (0.0, 0.0, 0.0)

    def __call__(self, _time_ns):
        return self.value


@dataclass
class Bench:
    """An emulated device that runs, its driver, and what it feels."""

    device: Any
    driver: str
    felt: Felt
    channel: str = "force_n"

    def __post_init__(self):
        self.sensor = self.load()

    def load(self, **more):
        return load_device(self.driver, {**self.device.options, **more})

    def near(self, felt=(0.0, 0.0, 0.0)):
        """Return about what frames have where this is felt."""
        gravity = GRAVITY_M_S2 * (self.channel == "acceleration_m_s2")
        return pytest.approx(np.add(felt, (0.0, 0.0, gravity)), abs=0.15)


def plus(felt, x, y, z):
    """What is felt, and this."""
    return lambda time_ns: tuple(np.add(felt(time_ns), (x, y, z)).tolist())


def weighed(felt):
    """What is felt, and the tool's weight, which the bias takes away."""
    return plus(felt, 0.3, -0.2, 0.5)


def upright(felt):
    """What is felt, and gravity."""
    return plus(felt, 0.0, 0.0, GRAVITY_M_S2)


def net_ft(started, felt):
    return Bench(started(EmulatedNetFt(weighed(felt), noise_n=0.001)), "ati-net-ft", felt)


def digital_ft(started, felt):
    return Bench(started(EmulatedDigitalFt(weighed(felt), 115_200)), "ati-digital-ft", felt)


def adxl335(started, felt):
    board = started(EmulatedAdxl335Board(upright(felt), rate_hz=2000.0))
    return Bench(board, "adxl335-serial", felt, "acceleration_m_s2")


def bota(started, felt):
    return Bench(started(EmulatedBota(weighed(felt))), "bota-serial", felt)


def iio(started, felt):
    device = started(EmulatedIio(upright(felt)))
    return Bench(device, "iio-accelerometer", felt, "acceleration_m_s2")


@pytest.fixture(params=[net_ft, digital_ft, adxl335, bota, iio])
def bench(request, started):
    return request.param(started, Felt())


@pytest.fixture
def running(bench, started):
    force, acceleration = (
        (bench.sensor, None) if bench.channel == "force_n" else (None, bench.sensor)
    )
    return started(RunningSource(force, acceleration))


def back_and_right(bench, running):
    """Run until the device is back, and see that its frames are true and its zero still holds."""
    running.run(lambda _: not running.is_lost)
    frames = running.run(lambda number: number >= 150)
    assert frames[bench.channel][100:].mean(axis=0) == bench.near(PRESSED)


def test_what_is_unplugged_is_lost_and_comes_back_with_its_zero(bench, running):
    frames = running.run(lambda number: number >= 100)
    assert frames[bench.channel].mean(axis=0) == bench.near()
    bench.device.unplug()
    running.run(lambda _: running.is_lost)
    bench.felt.value = PRESSED  # a tool that presses now must not be taken for one at rest
    turns = itertools.count()
    assert len(running.run(lambda _: next(turns) > 100)) == 0
    bench.device.plug()
    back_and_right(bench, running)


SERIAL = (
    "the port is gone .*; plug it in again",
    "its serial port: there is none; plug the board in",
)
UNPLUGGED = {
    "ati-net-ft": (r"no record for \d+ ms; check the box's power", "does not answer"),
    "ati-digital-ft": SERIAL,
    "adxl335-serial": SERIAL,
    "bota-serial": SERIAL,
    "iio-accelerometer": (
        r"it captures no longer; /.* is gone; check the wires",
        "industrial I/O has no accelerometer",
    ),
}
"""What a driver says while it reads, and where it is to connect again."""


def test_what_is_unplugged_is_explained_and_goes_on_in_time(bench):
    sensor, (gone, absent) = bench.sensor, UNPLUGGED[bench.driver]
    sensor.connect()
    before = read_some(sensor)
    sensor.calibrate()
    bench.device.unplug()
    read_until_lost(sensor, gone)
    check_refused(sensor.connect, absent)
    check_refused(sensor.read, "is closed", DeviceLost)
    bench.device.plug()
    sensor.connect()
    after = read_some(sensor)
    assert after[0].time_ns > before[-1].time_ns
    assert after[-1].value == bench.near()
    sensor.close()


@pytest.mark.parametrize("bench", [digital_ft, adxl335, bota], indirect=True)
def test_a_port_that_is_in_use_or_not_permitted_is_explained(bench, monkeypatch):
    bench.sensor.connect()
    check_refused(bench.load().connect, "another program has it open")
    bench.sensor.close()

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr("os.open", refuse)
        check_refused(bench.sensor.connect, r"no permission\. On Linux add yourself to the group")


USELESS = {
    "ati-net-ft": (*2 * ("status 0x80000400",), "error status"),
    "ati-digital-ft": (
        r"for \d+ ms no record was usable",
        r"for \d+ ms no record was usable",
        "error bit",
    ),
    "adxl335-serial": (
        "sends no good frames",
        "no good frames: the baud rate is probably not 500000",
        "bad",
    ),
    "bota-serial": (
        *2 * ("its measurements are invalid .*: unload it",),
        "invalid measurements",
    ),
    "iio-accelerometer": (*2 * ("impossible time stamps",), "impossible stamp"),
}
"""What is told of a device that gives nothing usable, while it reads and where it is to connect,
and how the names of what is counted begin."""


def faulty(bench, *, bad):
    """Have nothing but garbage come, or no longer."""
    device = bench.device
    if isinstance(device, EmulatedNetFt):
        device.status = 0x80000400 if bad else 0
    elif isinstance(device, EmulatedDigitalFt):
        device.error = bad
    elif isinstance(device, EmulatedBota):
        device.status = INVALID if bad else 0
    else:
        device.scramble(scrambled=bad)


def test_a_device_that_gives_nothing_usable_is_lost_and_comes_back(bench, running):
    running.run(lambda number: number >= 50)
    faulty(bench, bad=True)
    told, _, counted = USELESS[bench.driver]
    running.run_until_told(told)
    bench.felt.value = PRESSED
    faulty(bench, bad=False)
    back_and_right(bench, running)
    assert any(fault.startswith(counted) for fault in bench.sensor.faults)


def test_a_device_that_gives_nothing_usable_is_refused_until_it_does(bench, connected):
    faulty(bench, bad=True)
    patience = {} if bench.driver.startswith("ati") else {"start_s": 0.3}
    sensor = bench.load(**patience)
    check_refused(sensor.connect, USELESS[bench.driver][1])
    faulty(bench, bad=False)
    assert read_some(connected(sensor))


STUCK = "very same values|never changes|has not changed"


def test_a_stuck_device_is_refused(bench, connected):
    sensor = connected(bench.load())
    read_some(sensor, 20)
    bench.device.stuck = True
    read_until_lost(sensor, STUCK)
    check_refused(sensor.connect, STUCK)


def test_a_stuck_device_stays_lost_until_its_value_changes(bench, running):
    running.run(lambda number: number >= 50)
    bench.device.stuck = True
    running.run_until_told("very same values|has not changed")
    lost = len(running.told)
    turns = itertools.count()
    assert len(running.run(lambda _: next(turns) > 1500)) == 0
    assert all(is_lost for is_lost, _ in running.told[lost:])  # it has not been back in between
    bench.felt.value = PRESSED
    bench.device.stuck = False
    back_and_right(bench, running)
