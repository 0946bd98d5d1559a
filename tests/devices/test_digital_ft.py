"""The Digital F/T's driver on the emulated sensor, over a pseudo terminal."""

import itertools
import sys
import time

import numpy as np
import pytest
from sensor_reading import check_times_rise, read_some, read_until_fault, read_until_lost
from waiting import check_refused

from mmt.core.errors import InputError
from mmt.devices.ati.digital_ft import record_rate_hz
from mmt.devices.ati.digital_wire import GAINS, STATUS
from mmt.devices.drivers import load_device

if sys.platform != "linux":
    pytest.skip("the emulated port is for Linux", allow_module_level=True)

from mmt.testing.emulated.digital_ft import EmulatedDigitalFt

DRIVER = "ati-digital-ft"
FORCE = (0.5, -0.25, 2.0)
NEAR = pytest.approx(FORCE, abs=0.03)


@pytest.fixture
def emulated(started):
    return started(EmulatedDigitalFt(lambda _time_ns: FORCE, 115_200))


@pytest.fixture
def make(emulated, connected):
    """Connects a driver of the emulated sensor that has these options besides."""
    return lambda **more: connected(load_device(DRIVER, {**emulated.options, **more}))


@pytest.fixture
def sensor(make):
    return make()


def test_forces_come_at_the_lines_rate(sensor):
    readings = read_some(sensor, 200)
    period_ns = 1e9 * 143 / 115_200
    steps = [b.time_ns - a.time_ns for a, b in itertools.pairwise(readings)]
    assert sorted(steps)[100] == pytest.approx(period_ns, abs=1)
    assert all(reading.value == NEAR for reading in readings)
    assert sensor.latency_ns == round(period_ns)  # the time on the line


def test_the_full_rate_is_averaged_two_at_a_time(started, connected):
    assert (record_rate_hz(1_250_000), round(record_rate_hz(19_200))) == (7000.0, 134)
    emulated = started(EmulatedDigitalFt(lambda _time_ns: FORCE, noise_counts=20.0))
    sensor = connected(load_device(DRIVER, emulated.options))
    readings = read_some(sensor, 100)
    steps = [b.time_ns - a.time_ns for a, b in itertools.pairwise(readings)]
    assert sorted(steps)[50] == pytest.approx(285_714, abs=1)
    assert sensor.latency_ns == round(0.5 / 7000 * 1e9 + 143 / 1.25e6 * 1e9)
    noise_n = np.std([reading.value[2] for reading in readings])
    assert noise_n == pytest.approx(0.02, rel=0.5)  # three gauges, 0.001 N each


def test_gauges_are_amplified_as_the_calibration_wants(emulated, sensor):
    assert emulated.registers[GAINS] == 500
    assert sensor.faults["gauge settings written"] == 1
    sensor.connect()
    assert sensor.faults["gauge settings written"] == 1


# Each on a port of its own: a pseudo terminal may refuse its settings when it is opened again.


def test_another_sensor_than_expected_is_explained(make):
    with pytest.raises(InputError, match="its serial number is FT00018, expected is FT9"):
        make(serial="FT9")
    check_refused(lambda: make(calibration_number=3), "no usable calibration of this number")


def test_a_sensor_that_streams_already_is_stopped_first(emulated, make):
    emulated.stream()  # as after a crash
    assert read_some(make())[-1].value == NEAR


def test_a_bad_status_is_explained(emulated, make):
    emulated.registers[STATUS] = 0x0020
    check_refused(make, r"status 0x0020 .supply voltage too low.; check its supply")


def test_a_sensor_without_power_is_explained(emulated, make):
    emulated.deaf = True
    check_refused(make, "does not answer at 115200 baud: check its power, the cab")


def test_a_gap_is_no_error_in_time_and_silence_is_lost(emulated, make):
    sensor = make(silence_ms=5000)
    readings = read_some(sensor)
    emulated.stall()
    time.sleep(0.15)
    readings += sensor.read()  # the last record may have been on its way
    before_ns = readings[-1].time_ns
    time.sleep(0.15)
    assert not sensor.read()
    emulated.stall(silent=False)
    readings += read_until_fault(sensor, "lost record", 50)
    readings += read_some(sensor)
    assert readings[-1].time_ns - before_ns > 150_000_000
    for spoil, *how in ((emulated.flip, 4), (emulated.cut, 5), (emulated.cut, 12, 13, 0, 1)):
        spoil(*how)
        readings += read_until_fault(sensor, "wrong sum")
        readings += read_some(sensor)
    check_times_rise(readings)
    assert sum(reading.value != NEAR for reading in readings) <= 4  # the sum misses some flips
    sensor.close()
    sensor = make()
    read_some(sensor)
    emulated.stall()
    read_until_lost(sensor, r"no record for \d+ ms; check the sensor's power")


def test_saturation_and_overload_are_counted(started, connected):
    emulated = started(EmulatedDigitalFt(lambda _time_ns: (0.0, 0.0, 16.5), 115_200))
    sensor = connected(load_device(DRIVER, emulated.options))
    sensor.calibrate()
    emulated.truth = lambda _time_ns: (0.0, 0.0, 39.0)
    read_until_fault(sensor, "overload", 5)
    emulated.truth = lambda _time_ns: (0.0, 0.0, 120.0)
    read_until_fault(sensor, "saturation", 5)


def test_a_wrong_baud_rate_is_explained(emulated):
    wrong = load_device(DRIVER, {"port": emulated.path, "baud": 19_200})
    emulated.stream()
    check_refused(wrong.connect, "bytes came that make no sense: check 'baud'")
