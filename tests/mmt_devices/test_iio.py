"""The driver of industrial I/O on a tree of attributes and a FIFO: values, times, faults."""

import itertools
import logging
import shutil
import time

import pytest
from iio_drivers import LEVEL, emulated_adxl345, emulated_iio, iio_drivers  # noqa: F401 - fixtures
from sensor_reading import check_times_rise, read_some, read_until_fault

from mmt.devices.adxl335.gravity import GRAVITY_M_S2
from mmt.devices.protocols import ArrivalStamping
from mmt_devices.iio.emulated import EmulatedIio

NEAR = pytest.approx(LEVEL, abs=0.15)
PERIOD_NS = 500_000
EN = "scan_elements/in_accel_x_en"


@pytest.fixture
def sensor(emulated, drivers, connected):
    return connected(drivers(emulated))


# --- values and times


def test_values_are_the_truth_and_times_the_kernels(emulated, sensor):
    assert emulated.read("in_accel_sampling_frequency") == "2000.000000"
    assert emulated.read("current_timestamp_clock") == "monotonic"
    before_ns = time.monotonic_ns()
    readings = [one for one in read_some(sensor, 300) if one.time_ns > before_ns]
    assert all(reading.value == NEAR for reading in readings)
    steps = {b.time_ns - a.time_ns for a, b in itertools.pairwise(readings)}
    assert min(steps) == pytest.approx(PERIOD_NS, abs=1)
    assert readings[-1].time_ns <= time.monotonic_ns()
    assert isinstance(sensor, ArrivalStamping)
    assert sensor.arrival_ns >= readings[-1].time_ns


def test_axes_scale_and_offset_are_applied(emulated, drivers, connected):
    emulated.write("in_accel_scale", "0.00007649")
    emulated.write("in_accel_y_offset", "1000")
    sensor = connected(drivers(emulated, axes=["x", "-z", "y"], latency_ms=0.6))
    expected = (1.0, -2.0 * GRAVITY_M_S2, (-0.25 / 0.000038245 + 1000) * 0.00007649)
    assert read_some(sensor)[-1].value == pytest.approx(expected, abs=0.3)
    assert sensor.latency_ns == 600_000


def test_a_sensor_without_stamps_is_counted(adxl345, drivers, connected):
    sensor = connected(drivers(adxl345, stamps="counted", rate_hz=1000))
    assert adxl345.read("in_accel_sampling_frequency") == "1600.000000"
    readings = read_some(sensor, 100)
    assert all(reading.value == NEAR for reading in readings)
    steps = {b.time_ns - a.time_ns for a, b in itertools.pairwise(readings)}
    assert steps == {625_000}
    assert not isinstance(sensor, ArrivalStamping)


def test_the_directories_of_later_kernels_do_as_well(started, drivers, connected):
    emulated = started(EmulatedIio(lambda _time_ns: LEVEL, old=False))
    sensor = connected(drivers(emulated))
    assert emulated.read("buffer0/in_accel_x_en") == "1"
    assert read_some(sensor)[-1].value == NEAR
    sensor.close()
    assert emulated.read("buffer0/enable") == "0"


# --- settings


def test_what_was_changed_is_put_back_and_nothing_else(emulated, drivers, connected):
    emulated.write(EN, "1")
    emulated.write("scan_elements/in_temp_en", "1")
    emulated.write("buffer/watermark", "16")
    before = attributes(emulated)
    sensor = connected(drivers(emulated))
    assert emulated.read("scan_elements/in_temp_en") == "0"
    assert emulated.read("buffer/length") == "1024"
    assert emulated.read("buffer/watermark") == "1"
    read_some(sensor)
    sensor.close()
    sensor.close()
    assert attributes(emulated) == before


def attributes(emulated):
    return {
        str(path): path.read_text(encoding="ascii").strip()
        for path in emulated.directory.rglob("*")
        if path.is_file()
    }


def test_a_buffer_that_a_killed_program_left_on_is_taken(emulated, drivers, connected):
    emulated.write("buffer/enable", "1")
    sensor = connected(drivers(emulated))
    assert read_some(sensor)
    sensor.close()
    assert emulated.read("buffer/enable") == "0"


def test_the_rate_is_the_next_that_the_sensor_has(emulated, drivers, connected):
    for rate_hz, taken in ((600, "1000.000000"), (4000, "4000.000000"), (9000, "4000.000000")):
        sensor = connected(drivers(emulated, rate_hz=rate_hz))
        assert emulated.read("in_accel_sampling_frequency") == taken
        sensor.close()
    emulated.write("in_accel_sampling_frequency_available", "[100 1 1500]")
    sensor = connected(drivers(emulated, rate_hz=9000))
    assert emulated.read("in_accel_sampling_frequency") == "1500"


def test_a_timer_can_be_its_trigger(emulated, drivers, connected):
    emulated.write("../trigger7/name", "mmt")
    emulated.write("../trigger7/sampling_frequency", "100")
    sensor = connected(drivers(emulated, trigger="mmt"))
    assert emulated.read("trigger/current_trigger") == "mmt"
    assert emulated.read("../trigger7/sampling_frequency") == "2000"
    sensor.close()
    assert emulated.read("trigger/current_trigger") == "adxl355-dev0"
    assert emulated.read("../trigger7/sampling_frequency") == "100"


def test_the_sensors_own_trigger_is_set_where_none_is(emulated, drivers, connected):
    emulated.write("trigger/current_trigger", "")
    connected(drivers(emulated))
    assert emulated.read("trigger/current_trigger") == "adxl355-dev0"


# --- faults


def test_lost_scans_are_counted(emulated, sensor):
    read_some(sensor)
    emulated.cut(*[0] * 7)
    read_until_fault(sensor, "lost samples", 7)
    assert read_some(sensor)[-1].value == NEAR


def test_a_buffer_that_is_not_read_in_time_runs_over_and_is_counted(emulated, drivers, connected):
    sensor = connected(drivers(emulated, length=16))
    end = time.monotonic() + 20.0
    while emulated.dropped < 50:
        assert time.monotonic() < end
        time.sleep(0.002)
    readings = read_until_fault(sensor, "full buffer") + read_until_fault(
        sensor, "lost samples", 50
    )
    check_times_rise(readings)


def test_scans_in_two_parts_are_put_together(emulated, sensor):
    emulated.split(20)
    readings = read_some(sensor, 100)
    assert all(reading.value == NEAR for reading in readings)
    assert "impossible stamp" not in sensor.faults


def test_flipped_bits_move_no_time_back(emulated, sensor):
    readings = read_some(sensor)
    emulated.flip(100)
    readings += read_until_fault(sensor, "impossible stamp", 5)
    readings += read_some(sensor, 200)
    check_times_rise(readings)
    assert max(reading.time_ns for reading in readings) <= time.monotonic_ns() + 1_000_000
    assert readings[-1].value == NEAR


def test_what_is_beyond_its_range_is_counted(emulated, drivers, connected):
    sensor = connected(drivers(emulated, range_g=1.5))
    read_some(sensor)
    assert not sensor.faults.get("overload")
    emulated.truth = lambda _time_ns: (0.0, 0.0, 17.0)
    read_until_fault(sensor, "overload", 5)
    wide = drivers(emulated)
    sensor.close()
    wide.connect()
    assert read_some(wide)[-1].value[2] == pytest.approx(17.0, abs=0.2)
    assert not wide.faults.get("overload")
    emulated.truth = lambda _time_ns: (0.0, 0.0, -30.0)  # cut off at 20.05
    readings = read_until_fault(wide, "overload", 5)
    assert min(reading.value[2] for reading in readings) == pytest.approx(-20.05, abs=0.01)


def test_silence_is_explained_as_far_as_the_kernel_tells(emulated, sensor):
    assert sensor.explain_fault() == ""
    emulated.write("trigger/current_trigger", "")
    assert "its trigger is gone" in sensor.explain_fault()
    emulated.write("buffer/enable", "0")
    assert "another program has switched its buffer off" in sensor.explain_fault()
    shutil.rmtree(emulated.directory / "buffer")
    assert "is gone; check the wires" in sensor.explain_fault()


def test_a_sensor_that_does_not_feel_gravity_is_told_at_the_start(emulated, sensor, caplog):
    with caplog.at_level(logging.WARNING):
        sensor.calibrate()
        assert not caplog.records
        emulated.truth = lambda _time_ns: (0.0, 0.0, 7.0)
        read_some(sensor, 100)
        sensor.calibrate()
    assert "measures 7.0" in caplog.text
