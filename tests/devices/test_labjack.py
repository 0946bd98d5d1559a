"""A LabJack U6: its calibration, its stream through pyusb, and one in another process."""

import time
from itertools import pairwise
from types import SimpleNamespace

import pytest
import usb.core
from driver_fixtures import own_calibrations  # noqa: F401 - a fixture
from sensor_reading import read_some
from waiting import check_refused

from mmt.core.errors import InputError, MmtError
from mmt.devices.drivers import load_device
from mmt.devices.labjack import packets, usb_link
from mmt.devices.labjack.board import BoardOptions, U6Voltages
from mmt.devices.labjack.packets import AnalogInput
from mmt.devices.labjack.scans import CentredLines, nominal_lines, read_lines, write_lines
from mmt.testing.emulated.labjack_u6 import ENDPOINTS, EmulatedU6, EmulatedU6Voltages
from mmt.testing.emulated.remote_u6 import RemoteU6, U6Server


def test_a_calibration_memory_is_read_as_it_is_written():
    lines = tuple(
        CentredLines(33_500.0 + k, 3.15e-4 / gain, -3.16e-4 / gain)
        for k, gain in enumerate(packets.GAINS)
    )
    for found, wanted in zip(read_lines(write_lines(lines)), lines, strict=True):
        assert list(found) == pytest.approx(list(wanted), rel=0, abs=2**-33)
    line = lines[0]
    assert line.volts(33_500) == 0.0
    assert line.volts(33_600) == pytest.approx(0.0315)
    assert line.volts(33_400) == pytest.approx(-0.0316)
    assert nominal_lines()[0].volts(0) == pytest.approx(-10.587, abs=1e-3)
    with pytest.raises(ValueError, match="calibration memory holds"):
        read_lines([b"\xff" * 32] * 4)  # erased


def inputs(*numbers, backend=None, rate_hz=1000.0, **options):
    return U6Voltages(BoardOptions(inputs=numbers, rate_hz=rate_hz, **options), backend)


def level(time_ns):
    """Return an input of 0.1 V a number, which never quite stands still."""
    return [0.1 * n + 0.001 * (time_ns // 1_000_000 % 3) for n in range(14)]


def test_nine_inputs_carry_a_force_sensors_gauges_and_an_accelerometer(connected):
    box = EmulatedU6(level)
    source = connected(inputs(*range(9), backend=box))
    assert source.serial == "u6-360000001"
    got = read_some(source, 300)  # the packets' counter wraps at 256
    assert [t for t, _ in got] == [1_000_000 * k for k in range(len(got))]
    for _, volts in got:
        assert volts == pytest.approx([0.1 * n for n in range(9)], abs=0.0025)
    assert not source.faults


def test_differential_inputs_and_gains(connected):
    box = EmulatedU6(lambda _: [0.0, 0.5, 0.52, 0.5, -0.3] + [0.0] * 9)
    pairs = connected(inputs(2, backend=box, gain=100, differential=True))
    single = connected(inputs(4, backend=box, gain=10))
    plain = connected(inputs(1, backend=box))
    assert len(box.table) == 3
    for _, volts in read_some(pairs, 20):
        assert volts == pytest.approx([0.02], abs=2e-4)
    assert read_some(single, 20)[-1].volts == pytest.approx([-0.3], abs=2e-4)
    assert read_some(plain, 20)[-1].volts == pytest.approx([0.5], abs=2e-4)


def test_what_is_lost_or_spoilt_is_counted_and_times_stay_true(connected):
    box = EmulatedU6(level)
    source = connected(inputs(0, 1, 2, backend=box))
    got = read_some(source, 20)
    box.cut(*[0] * 5)
    got += read_some(source, 20)
    box.flip(2)
    got += read_some(source, 20)
    box.cut(10, 13)
    got += read_some(source, 20)
    box.overflow(100)
    got += read_some(source, 150)
    times = [t for t, _ in got]
    assert times == sorted(set(times))
    missing = times[-1] // 1_000_000 + 1 - len(got)
    assert missing == source.faults["lost scans"] == 5 + 2 + 2 + 100
    assert source.faults["bad packets"] == 4
    assert source.faults["overflows"] == 1


def test_a_stream_that_a_program_left_behind_is_ended(closing):
    box = EmulatedU6(level)
    left = usb_link.U6Stream(None, box, 1000.0, lambda _: (AnalogInput(0),))
    source = closing(inputs(5, backend=box))
    check_refused(source.connect, "another program has the LabJack U6 open")
    left._ending.set()
    box.kill_program()  # nothing stops the stream
    source.connect()
    for _, volts in read_some(source, 20):
        assert volts == pytest.approx([0.5], abs=0.0025)


def test_a_box_that_goes_on_sending_is_opened_all_the_same(closing):
    class Deaf(EmulatedU6):
        def bulk_read(self, handle, endpoint, interface, buffer, timeout):
            if endpoint == ENDPOINTS[2] and not self.streaming:
                return len(buffer)
            return super().bulk_read(handle, endpoint, interface, buffer, timeout)

    closing(inputs(0, backend=Deaf(level))).connect()


def test_what_keeps_a_box_from_being_opened_is_told(monkeypatch):
    box = EmulatedU6(level)
    with pytest.raises(MmtError, match="with serial number 7 on USB: plug it in; there is 36000"):
        inputs(0, box=7, backend=box).connect()
    box.forbid()
    check_refused(inputs(0, backend=box).connect, "udev rule")
    box.forbid(forbidden=False)
    box.erase()
    check_refused(inputs(0, backend=box).connect, "is not calibrated")

    def absent(**_):
        raise usb.core.NoBackendError("none")

    monkeypatch.setattr(usb_link.usb, "core", SimpleNamespace(**vars(usb.core) | {"find": absent}))
    check_refused(inputs(0).connect, r"libusb 1\.0 is not there: install it")


def test_the_name_of_an_earlier_driver_is_told_by_its_new_one():
    with pytest.raises(InputError, match=r'no longer one; write driver = "adxl335-board".* inputs'):
        load_device("adxl335-u6", {"inputs": [1, 2, 3]})


REMOTE = {"driver": f"{EmulatedU6Voltages.__module__}:EmulatedU6Voltages", "inputs": [0, 1, 2]}


def test_one_in_another_process_is_read_as_if_it_were_here(
    started, closing, connected, monkeypatch
):
    server = started(U6Server(EmulatedU6(lambda _time_ns: [1.65, 1.65, 1.98] + [0.0] * 11)))
    remote = closing(RemoteU6(server.address))
    monkeypatch.setattr(EmulatedU6Voltages, "at", remote)
    sensor = connected(load_device("adxl335-board", {"board": REMOTE, "bandwidth_hz": 1000}))
    readings = read_some(sensor, 100)
    assert sensor.serial_number == "u6-360000001"
    assert readings[-1].value[2] == pytest.approx(9.8, abs=0.3)
    assert 0 < remote.own_ns < time.process_time_ns()
    assert {b.time_ns - a.time_ns for a, b in pairwise(readings)} == {500_000}


def test_one_whose_process_has_ended_is_gone(monkeypatch):
    server = U6Server(EmulatedU6(level))
    server.start()
    remote = RemoteU6(server.address)
    remote.close()
    server.stop()
    monkeypatch.setattr(EmulatedU6Voltages, "at", remote)
    with pytest.raises(MmtError, match="gone"):
        load_device("adxl335-board", {"board": REMOTE}).connect()
