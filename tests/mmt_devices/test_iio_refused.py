"""What the driver of industrial I/O refuses, and what it says to do."""

import os
import shutil
from pathlib import Path

import pytest
from iio_drivers import emulated_adxl345, emulated_iio, iio_drivers  # noqa: F401 - fixtures

from mmt.core.errors import InputError, MmtError
from mmt.devices.discovery import FoundPort
from mmt_devices.iio.attributes import find_iio_accelerometers


def test_what_is_not_there_is_told_with_what_is(emulated, drivers, tmp_path):
    for options, words in (
        ({"device": "adxl372"}, r"no device 'adxl372' in .*; there are iio:device0 \(adxl355\)"),
        ({"sysfs_root": str(tmp_path)}, "no accelerometer in .*; there are none: check the over"),
    ):
        with pytest.raises(InputError, match=words):
            drivers(emulated, **options).connect()
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


def test_no_trigger_is_told(emulated, drivers):
    with pytest.raises(MmtError, match="there is no trigger 'mmt'; there are adxl355-dev0: wire"):
        drivers(emulated, trigger="mmt").connect()
    emulated.write("trigger/current_trigger", "")
    shutil.rmtree(emulated.directory.parent / "trigger0")
    with pytest.raises(MmtError, match="it has no trigger; there are none: wire its interrupt"):
        drivers(emulated).connect()


def test_a_trigger_for_a_sensor_that_takes_none_is_refused(adxl345, drivers):
    with pytest.raises(MmtError, match="it takes no trigger; leave 'trigger' out"):
        drivers(adxl345, trigger="mmt", stamps="counted").connect()


def test_no_stamps_are_told(adxl345, emulated, drivers):
    with pytest.raises(MmtError, match=r'no time stamps .*: set stamps = "counted"'):
        drivers(adxl345).connect()
    (emulated.directory / "current_timestamp_clock").unlink()
    with pytest.raises(MmtError, match=r"a clock that is set at times: take Linux 4\.7"):
        drivers(emulated).connect()


def test_a_sensor_whose_interrupt_is_not_wired_is_told(emulated, drivers):
    emulated.stall()
    with pytest.raises(MmtError, match=r"no sample for 0\.2 s though its buffer runs; check the w"):
        drivers(emulated, start_s=0.2).connect()
    assert emulated.read("buffer/enable") == "0"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("float", "has the type 'float' at '0', which is none"),
        ("le:s12/16X2>>4", "has the type 'le:s12/16X2>>4', which no accelerometer has"),
        ("le:s12/16>>5", "which no accelerometer has"),
    ],
)
def test_a_type_that_no_accelerometer_has_is_told(emulated, drivers, content, words):
    emulated.write("scan_elements/in_accel_x_type", content)
    with pytest.raises(MmtError, match=words):
        drivers(emulated).connect()


def test_a_driver_of_the_kernel_without_scale_or_with_none_that_is_a_number_is_told(
    emulated, drivers
):
    for held in ("n/a", "nan", "inf"):
        emulated.write("in_accel_scale", held)
        with pytest.raises(MmtError, match=f"in_accel_scale holds '{held}' and no finite number"):
            drivers(emulated).connect()
    (emulated.directory / "in_accel_scale").unlink()
    with pytest.raises(MmtError, match="gives no scale: in_accel_x_scale"):
        drivers(emulated).connect()


def test_counting_without_a_rate_is_refused(adxl345, drivers):
    for name in ("in_accel_sampling_frequency", "in_accel_sampling_frequency_available"):
        (adxl345.directory / name).unlink()
    with pytest.raises(MmtError, match="nothing tells its rate"):
        drivers(adxl345, stamps="counted").connect()


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
        with pytest.raises(MmtError, match=words):
            drivers(emulated).connect()
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_text", refuse)
        with pytest.raises(MmtError, match=words):
            drivers(emulated).connect()


def test_accelerometers_are_listed_and_what_is_not_permitted_is_told(emulated, monkeypatch):
    emulated.write("../iio:device1/name", "a thermometer")
    roots = [Path(each) for each in emulated.options.values()]
    assert find_iio_accelerometers(*roots) == [FoundPort("iio:device0", "adxl355", "", "")]
    monkeypatch.setattr("os.access", lambda _path, way: way == os.R_OK)
    (found,) = find_iio_accelerometers(*roots)
    assert found.problem.startswith(f"no permission for {emulated.directory}/buffer/enable")
