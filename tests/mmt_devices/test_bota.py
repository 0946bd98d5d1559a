"""The driver of Bota's serial sensors on the emulated sensor, over a pseudo terminal."""

import itertools
import sys

import pytest
from sensor_reading import (
    check_times_rise,
    read_some,
    read_until,
    read_until_fault,
    read_until_lost,
)

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.drivers import load_device
from mmt_devices.bota.frames import OVERRANGE, RAW, SKIPPED

if sys.platform != "linux":
    pytest.skip("the emulated port is for Linux", allow_module_level=True)

from mmt_devices.bota.emulated import EmulatedBota

FORCE = (0.5, -0.25, 2.0)
NEAR = pytest.approx(FORCE, abs=0.06)
PERIOD_NS = 51 / 51_200 * 1e9


@pytest.fixture
def emulated(started):
    return started(EmulatedBota(lambda _time_ns: FORCE))


@pytest.fixture
def make(emulated, connected):
    """Connects a driver of the emulated sensor that has these options besides."""
    return lambda **more: connected(load_device("bota-serial", {**emulated.options, **more}))


@pytest.fixture
def sensor(make):
    return make()


def test_forces_come_at_the_rate_of_the_filter_by_the_sensors_clock(emulated, sensor):
    assert emulated.filter == (51, 0, 0, 1)
    readings = read_some(sensor, 200)
    steps = sorted(b.time_ns - a.time_ns for a, b in itertools.pairwise(readings))
    assert steps[0] > 0
    assert steps[100] == pytest.approx(PERIOD_NS, abs=1000)
    assert all(reading.value == NEAR for reading in readings)
    assert sensor.latency_ns == round(1e9 * 370 / 460_800)  # the time on the line
    assert not sensor.faults.keys() - {"lost frame"}  # a busy machine loses some


def test_the_filter_is_set_as_the_options_say(emulated, make):
    sensor = make(sinc_length=64, fir=True)
    assert emulated.filter == (64, 0, 0, 0)
    readings = read_some(sensor)
    steps = sorted(b.time_ns - a.time_ns for a, b in itertools.pairwise(readings))
    assert steps[25] == pytest.approx(1.25e6, abs=1000)


def test_a_sensor_can_be_left_as_it_is(emulated, make):
    emulated.deaf = True
    sensor = make(configure=False)
    assert emulated.filter == (512, 0, 0, 1)
    readings = read_some(sensor, 3)
    assert readings[1].time_ns - readings[0].time_ns == pytest.approx(1e7, abs=1000)


def test_text_and_raw_values_are_switched_to_forces(emulated, make):
    emulated.text, emulated.calibrated = True, False
    sensor = make()
    assert read_some(sensor)[-1].value == NEAR


def test_the_counter_of_microseconds_wraps_unseen(started, connected):
    emulated = started(EmulatedBota(lambda _time_ns: FORCE, start_us=2**32 - 700_000))
    sensor = connected(load_device("bota-serial", emulated.options))
    readings = read_until(sensor, has_wrapped)
    assert "restart" not in sensor.faults
    check_times_rise(readings)


def has_wrapped(readings):
    return bool(readings) and readings[-1].time_ns > (2**32 + 50_000) * 1000


def test_flipped_bits_and_half_frames_are_survived(emulated, sensor):
    readings = read_some(sensor)
    faults = (
        lambda: emulated.flip(4),
        lambda: emulated.cut(5),
        lambda: emulated.cut(36, 37, 0, 1),
        lambda: emulated.garble(b"garbage \xaa\x00\xff"),
    )
    for fault in faults:
        fault()
        readings += read_until_fault(sensor, "broken frame")
        readings += read_some(sensor)
    assert all(reading.value == NEAR for reading in readings)  # the CRC sees them all
    check_times_rise(readings)
    assert sensor.faults["lost frame"] >= 4


def test_a_gap_is_counted_and_no_error_in_time(emulated, make):
    sensor = make(silence_ms=10_000)
    before = read_some(sensor)
    emulated.cut(*[0] * 100)
    readings = before[-1:] + read_until_fault(sensor, "lost frame", 100) + read_some(sensor)
    longest_ns = max(b.time_ns - a.time_ns for a, b in itertools.pairwise(readings))
    assert longest_ns >= 100 * PERIOD_NS


def test_frames_that_come_twice_are_left_out(emulated, sensor):
    emulated.repeat(3)
    readings = read_until_fault(sensor, "repeated frame", 3)
    check_times_rise(readings)


def test_a_restart_continues_the_time(emulated, sensor):
    before = read_some(sensor)
    emulated.restart()
    after = read_until_fault(sensor, "restart")
    check_times_rise(before + after)


def test_an_unplugged_sensor_comes_back_with_its_settings(emulated, sensor):
    emulated.unplug()
    with pytest.raises(DeviceLost):
        read_until(sensor, lambda _: False)
    emulated.plug()
    sensor.connect()
    assert emulated.filter == (51, 0, 0, 1)


def test_silence_is_lost(emulated, make, sensor):
    read_some(sensor)
    emulated.stall()
    read_until_lost(sensor, r"no record for \d+ ms; check its power, its cable")
    sensor.close()
    with pytest.raises(MmtError, match=r"used in 0\.2 s; nothing comes; check its power"):
        make(start_s=0.2)


def test_raw_values_in_the_place_of_forces_are_told(emulated, make):
    words = r"values of its gauges .*: switch its calibration matrix on"
    sensor = make(start_s=0.3)
    read_some(sensor)
    emulated.status = RAW
    read_until_lost(sensor, words)
    assert sensor.faults["raw measurements"] > 0
    with pytest.raises(MmtError, match=words):
        sensor.connect()


def test_overrange_and_skipped_measurements_are_counted(emulated, sensor):
    emulated.status = OVERRANGE | SKIPPED
    readings = read_until_fault(sensor, "overrange", 5)
    assert sensor.faults["skipped measurements"] >= 5
    assert readings[-1].value == NEAR


def test_more_than_its_range_is_an_overload_and_much_more_is_left_out(emulated, make):
    sensor = make(range_n=[2.0, 2.0, 2.0])
    emulated.truth = lambda _time_ns: (0.0, 0.0, 3.0)
    read_until_fault(sensor, "overload", 5)
    emulated.truth = lambda _time_ns: (0.0, 0.0, float("nan"))
    read_until_fault(sensor, "impossible value", 5)


def test_a_wrong_baud_rate_is_explained(emulated, monkeypatch):
    monkeypatch.setattr("mmt_devices.bota.driver._ANSWER_S", 0.1)
    for configure in (True, False):
        options = {"port": emulated.path, "baud": 115_200, "sinc_length": 256}
        wrong = load_device("bota-serial", {**options, "configure": configure, "start_s": 0.3})
        with pytest.raises(MmtError, match="no good frames: the baud rate is probably not 115200"):
            wrong.connect()


def test_a_model_with_another_protocol_is_explained(emulated, make):
    emulated.header = 0xAB
    with pytest.raises(MmtError, match="or the model speaks another protocol"):
        make(start_s=0.3)


def test_a_sensor_that_sends_text_is_explained(emulated, make):
    emulated.text = True
    with pytest.raises(MmtError, match="text comes: set its data format to binary"):
        make(configure=False, start_s=0.3)


def test_a_sensor_that_does_not_answer_is_explained(emulated, make, monkeypatch):
    monkeypatch.setattr("mmt_devices.bota.driver._ANSWER_S", 0.1)
    emulated.deaf = True
    with pytest.raises(MmtError, match="not answer the command 'C'; its frames come, but what is"):
        make()


def test_a_command_that_is_refused_is_told(emulated, make):
    emulated.refusal = 3
    with pytest.raises(MmtError, match=r"it refuses the command 'C' \(code 3\): switch it off"):
        make()


def test_a_longer_filter_fits_a_slower_line():
    assert load_device("bota-serial", {"port": "x", "baud": 230_400, "sinc_length": 128})
