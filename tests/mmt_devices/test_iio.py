"""The driver of industrial I/O on a tree of attributes and a FIFO: scans, times, faults."""

import itertools
import logging
import os
import random
import shutil
import struct
import sys
import time
from pathlib import Path

import pytest
from sensor_reading import check_times_rise, read_some, read_until_fault
from waiting import check_refused, until

from mmt.core.errors import InputError, MmtError
from mmt.devices.adxl335.gravity import GRAVITY_M_S2
from mmt.devices.discovery import FoundPort
from mmt.devices.drivers import load_device
from mmt.devices.protocols import ArrivalStamping
from mmt_devices.iio.attributes import find_iio_accelerometers
from mmt_devices.iio.layout import Layout, parse_element

if sys.platform != "linux":
    pytest.skip("industrial I/O is a part of Linux", allow_module_level=True)

from mmt_devices.iio.emulated import EmulatedIio
from mmt_devices.iio.emulated_chips import ADXL345

LEVEL = (0.5, -0.25, GRAVITY_M_S2)
NEAR = pytest.approx(LEVEL, abs=0.15)
PERIOD_NS = 500_000
EN = "scan_elements/in_accel_x_en"


@pytest.fixture
def emulated(started):
    """One that is there."""
    return started(EmulatedIio(lambda _time_ns: LEVEL))


@pytest.fixture
def adxl345(started):
    """One without stamps and triggers."""
    return started(EmulatedIio(lambda _time_ns: LEVEL, ADXL345))


@pytest.fixture
def drivers(closing):
    """Makes drivers of emulated ones, which are closed at the end."""
    return lambda emulated, **more: closing(
        load_device("iio-accelerometer", {**emulated.options, **more})
    )


@pytest.fixture
def sensor(emulated, drivers, connected):
    return connected(drivers(emulated))


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


def test_a_buffer_that_a_killed_program_left_on_is_taken(emulated, drivers, connected):
    emulated.write("buffer/enable", "1")
    sensor = connected(drivers(emulated))
    assert read_some(sensor)
    sensor.close()
    assert emulated.read("buffer/enable") == "0"


def test_the_directories_of_later_kernels_do_as_well(started, drivers, connected):
    emulated = started(EmulatedIio(lambda _time_ns: LEVEL, old=False))
    sensor = connected(drivers(emulated))
    assert emulated.read("buffer0/in_accel_x_en") == "1"
    assert read_some(sensor)[-1].value == NEAR
    sensor.close()
    assert emulated.read("buffer0/enable") == "0"


def attributes(emulated):
    paths = [path for path in emulated.directory.rglob("*") if path.is_file()]
    return {str(path): path.read_text(encoding="ascii").strip() for path in paths}


def test_the_rate_is_the_next_that_the_sensor_has(emulated, drivers, connected):
    for rate_hz, taken in ((600, "1000.000000"), (4000, "4000.000000"), (9000, "4000.000000")):
        sensor = connected(drivers(emulated, rate_hz=rate_hz))
        assert emulated.read("in_accel_sampling_frequency") == taken
        sensor.close()
    emulated.write("in_accel_sampling_frequency_available", "[100 1 1500]")
    sensor = connected(drivers(emulated, rate_hz=9000))
    assert emulated.read("in_accel_sampling_frequency") == "1500"


def test_a_timer_can_be_its_trigger_or_the_sensor_where_none_is(emulated, drivers, connected):
    emulated.write("../trigger7/name", "mmt")
    emulated.write("../trigger7/sampling_frequency", "100")
    sensor = connected(drivers(emulated, trigger="mmt"))
    assert emulated.read("trigger/current_trigger") == "mmt"
    assert emulated.read("../trigger7/sampling_frequency") == "2000"
    sensor.close()
    assert emulated.read("trigger/current_trigger") == "adxl355-dev0"
    assert emulated.read("../trigger7/sampling_frequency") == "100"
    emulated.write("trigger/current_trigger", "")
    connected(drivers(emulated))
    assert emulated.read("trigger/current_trigger") == "adxl355-dev0"


def test_a_buffer_that_is_not_read_in_time_runs_over_and_is_counted(emulated, drivers, connected):
    sensor = connected(drivers(emulated, length=16))
    until(lambda: emulated.dropped >= 50)
    readings = read_until_fault(sensor, "full buffer")
    check_times_rise(readings + read_until_fault(sensor, "lost samples", 50))


def test_lost_split_and_spoilt_scans_move_no_time_back(emulated, sensor):
    readings = read_some(sensor)
    emulated.split(20)
    readings += read_some(sensor, 100)
    assert "impossible stamp" not in sensor.faults
    emulated.cut(*[0] * 7)
    readings += read_until_fault(sensor, "lost samples", 7)
    assert all(reading.value == NEAR for reading in readings)
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


def test_what_is_not_there_is_told_with_what_is(emulated, drivers, tmp_path):
    for options, words in (
        ({"device": "adxl372"}, r"no device 'adxl372' in .*; there are iio:device0 \(adxl355\)"),
        ({"sysfs_root": str(tmp_path)}, "no accelerometer in .*; there are none: check the over"),
    ):
        check_refused(drivers(emulated, **options).connect, words, InputError)
    for name in ("adxl355", "iio:device0", 0):
        sensor = drivers(emulated, device=name)
        sensor.connect()
        sensor.close()
    emulated.write("../iio:device1/name", "adxl355")
    emulated.write("../iio:device1/in_accel_x_raw", "0")
    with pytest.raises(InputError, match="has 2 of the accelerometer: name one by 'device'"):
        drivers(emulated).connect()
    with pytest.raises(MmtError, match="its driver in the kernel offers no buffer; a newer kernel"):
        drivers(emulated, device="1").connect()


def test_no_trigger_and_no_interrupt_are_told(emulated, drivers):
    emulated.stall()
    with pytest.raises(MmtError, match=r"no sample for 0\.2 s though its buffer runs; check the w"):
        drivers(emulated, start_s=0.2).connect()
    assert emulated.read("buffer/enable") == "0"
    with pytest.raises(MmtError, match="there is no trigger 'mmt'; there are adxl355-dev0: wire"):
        drivers(emulated, trigger="mmt").connect()
    emulated.write("trigger/current_trigger", "")
    shutil.rmtree(emulated.directory.parent / "trigger0")
    with pytest.raises(MmtError, match="it has no trigger; there are none: wire its interrupt"):
        drivers(emulated).connect()


def test_what_a_sensor_without_stamps_and_triggers_needs_is_told(adxl345, emulated, drivers):
    check_refused(drivers(adxl345).connect, r'no time stamps .*: set stamps = "counted"')
    with pytest.raises(MmtError, match="it takes no trigger; leave 'trigger' out"):
        drivers(adxl345, trigger="mmt", stamps="counted").connect()
    for name in ("in_accel_sampling_frequency", "in_accel_sampling_frequency_available"):
        (adxl345.directory / name).unlink()
    check_refused(drivers(adxl345, stamps="counted").connect, "nothing tells its rate")
    (emulated.directory / "current_timestamp_clock").unlink()
    check_refused(drivers(emulated).connect, r"a clock that is set at times: take Linux 4\.7")


def test_a_type_or_scale_that_no_accelerometer_has_is_told(emulated, drivers):
    for held in ("n/a", "nan", "inf"):
        emulated.write("in_accel_scale", held)
        with pytest.raises(MmtError, match=f"in_accel_scale holds '{held}' and no finite number"):
            drivers(emulated).connect()
    (emulated.directory / "in_accel_scale").unlink()
    check_refused(drivers(emulated).connect, "gives no scale: in_accel_x_scale")
    for held in ("float", "le:s12/16X2>>4", "le:s12/16>>5"):
        emulated.write("scan_elements/in_accel_x_type", held)
        check_refused(drivers(emulated).connect, f"has the type '{held}'.*, which ")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (PermissionError(13, "Permission denied"), "no permission for .*: files of industrial I/O"),
        (OSError(16, "Device or resource busy"), "in use: another program has it open"),
        (FileNotFoundError(2, "No such file"), "is gone; check the wires"),
        (
            OSError(22, "Invalid argument"),
            "the kernel refuses .*Invalid argument.; look with dmesg",
        ),
    ],
)
def test_what_the_kernel_refuses_is_explained(emulated, drivers, monkeypatch, error, words):
    def refuse(*_arguments, **_named):
        raise error

    with monkeypatch.context() as patch:
        patch.setattr("mmt_devices.iio.capture.os.open", refuse)
        check_refused(drivers(emulated).connect, words)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_text", refuse)
        check_refused(drivers(emulated).connect, words)


def test_accelerometers_are_listed_and_what_is_not_permitted_is_told(emulated, monkeypatch):
    emulated.write("../iio:device1/name", "a thermometer")
    roots = [Path(each) for each in emulated.options.values()]
    assert find_iio_accelerometers(*roots) == [FoundPort("iio:device0", "adxl355", "", "")]
    monkeypatch.setattr("os.access", lambda _path, way: way == os.R_OK)
    (found,) = find_iio_accelerometers(*roots)
    assert found.problem.startswith(f"no permission for {emulated.directory}/buffer/enable")


def test_a_scan_lies_as_the_kernels_documentation_has_it():
    kinds = {"a": "be:u16/16>>0", "b": "be:u32/32>>0", "c": "be:u32/32>>0", "d": "be:u64/64>>0"}
    elements = [parse_element(name, str(i), kind) for i, (name, kind) in enumerate(kinds.items())]
    layout = Layout(elements, "abcd")
    assert layout.size == 24
    scan = struct.pack(">HxxIIxxxxQ", 1, 2, 3, 4)
    assert list(layout.decode(scan + scan)) == [(1, 2, 3, 4)] * 2
    layout = Layout([elements[0], elements[3]], "da")
    assert layout.size == 16
    assert list(layout.decode(struct.pack(">H6xQ", 1, 4))) == [(4, 1)]
    assert Layout(elements[1:2] + elements[:1], "a").size == 8  # padded to its largest


def test_shifted_and_signed_values_are_decoded():
    element = parse_element("in_accel_y", "1", "le:s12/16>>4")
    assert element.bounds == (-2048, 2047)
    layout = Layout([element], [element.name])
    for value in (-2048, -1, 0, 1, 2047):
        word = (value % 4096) << 4 | 0xF  # what is beside the bits is none of the value
        assert list(layout.decode(word.to_bytes(2, "little"))) == [(value,)]
    unsigned = parse_element("in_accel_y", "1", "be:u20/32>>4")
    assert unsigned.bounds == (0, 2**20 - 1)
    random.seed(1)
    for value in (0, 1, 2**19, 2**20 - 1):
        word = value << 4 | random.randrange(16) | random.randrange(256) << 24
        assert list(Layout([unsigned], ["in_accel_y"]).decode(word.to_bytes(4, "big"))) == [
            (value,)
        ]
