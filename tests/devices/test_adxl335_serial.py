"""The driver adxl335-serial against a board on a pseudo-terminal: values, times, faults."""

import itertools
import logging
import sys
from pathlib import Path

import pytest
from driver_fixtures import own_calibrations  # noqa: F401 - a fixture
from sensor_reading import read_some, read_until, read_until_fault
from waiting import check_refused

from mmt.core.errors import MmtError
from mmt.devices.adxl335.gravity import GRAVITY_M_S2, GravityCalibration
from mmt.devices.calibrations import calibration_file, save_calibration
from mmt.devices.drivers import load_device

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

from mmt.testing.emulated.adxl335_board import EmulatedAdxl335Board

LEVEL = (0.0, 0.0, GRAVITY_M_S2)


@pytest.fixture
def boards(started):
    def start(truth=lambda _: LEVEL, **options):
        return started(EmulatedAdxl335Board(truth, **options))

    return start


@pytest.fixture
def drivers(closing):
    def make(board, **options):
        given = {"port": board.path, "bandwidth_hz": 500.0, "start_s": 2.0, **options}
        return closing(load_device("adxl335-serial", given))

    return make


def broken(sensor):
    return sensor.faults.get("bad checksums", 0) + sensor.faults.get("bad frames", 0)


def test_values_are_the_truth_and_times_the_boards(boards, drivers, connected):
    sensor = connected(drivers(boards(start_us=2**32 - 100_000)))  # wraps a tenth of a second later
    got = read_some(sensor, 300)
    for axis in range(3):
        mean = sum(r.value[axis] for r in got) / len(got)
        assert mean == pytest.approx(LEVEL[axis], abs=0.05)  # half a count, and the noise
    steps = {b.time_ns - a.time_ns for a, b in itertools.pairwise(got)}
    assert min(steps) == 1_000_000
    assert max(steps) < 10**9
    assert sensor.latency_ns == pytest.approx(318_310, abs=1)


def test_axes_are_turned_and_frames_of_many_samples_are_even(boards, drivers, connected):
    sensor = connected(drivers(boards(per_frame=8, rate_hz=4000.0), axes=["x", "-z", "y"]))
    got = read_some(sensor, 400)
    assert sum(r.value[1] for r in got) / len(got) == pytest.approx(-GRAVITY_M_S2, abs=0.1)
    steps = sorted(b.time_ns - a.time_ns for a, b in itertools.pairwise(got))
    assert steps[len(steps) // 2] == pytest.approx(250_000, abs=1000)


def test_spoilt_frames_are_counted_and_survived(boards, drivers, connected):
    board = boards()
    sensor = connected(drivers(board))
    board.flip(5)
    read_until(sensor, lambda _: broken(sensor) >= 2)  # a flipped end joins a frame with the next
    read_some(sensor, 30)
    flipped = broken(sensor)
    board.cut(9, 9)
    read_until(sensor, lambda _: broken(sensor) > flipped)  # the halves may count as one
    read_some(sensor, 30)
    board.cut(*[0] * 7)
    read_until_fault(sensor, "lost samples", 7)
    assert read_some(sensor, 30)
    board.restart()
    read_until_fault(sensor, "restarts")
    read_some(sensor, 200)
    assert sensor.faults["restarts"] == 1


def test_a_board_that_is_silent_or_sends_text_is_told(boards, drivers, monkeypatch):
    board = boards()
    board.stall()
    with pytest.raises(MmtError, match=r"sent nothing for 0\.2 s: check that the sketch"):
        drivers(board, start_s=0.2).connect()
    board = boards()
    monkeypatch.setattr(board, "_spoil", lambda wire: b"x: 512, y: 510\r\n")
    check_refused(drivers(board, start_s=0.2).connect, "sends text: another sketch")


def test_an_overload_is_cut_off_counted_and_told_once(boards, drivers, connected, caplog):
    sensor = connected(drivers(boards(lambda _: (50.0, 0.0, 9.8)), bandwidth_hz=500.0))
    with caplog.at_level(logging.WARNING, "mmt.devices"):
        felt = read_some(sensor, 20)
    assert felt[-1].value[0] == pytest.approx(3.6 * GRAVITY_M_S2, abs=0.1)
    assert sensor.faults["overload"] >= 20
    (message,) = [record.getMessage() for record in caplog.records]
    assert message.startswith("the accelerometer is overloaded: beyond 3 g along an axis")


def test_the_boards_capacitors_are_warned_of_once(boards, drivers, caplog):
    sensor = drivers(boards(), bandwidth_hz=50.0)
    with caplog.at_level(logging.WARNING, "mmt.devices"):
        sensor.connect()
        sensor.connect()
    (message,) = [r.getMessage() for r in caplog.records]
    assert "passes 50 Hz (0.1 uF at each output), the scene wants 500 Hz" in message
    assert "by 0.01 uF or less" in message
    turned = drivers(boards(), bandwidth_hz=1000.0, band_hz=800.0, axes=["x", "z", "-y"])
    (remark,) = turned.remarks()
    assert "here the scene's y, ends at 550 Hz" in remark


def test_a_stored_calibration_is_used_and_its_mismatch_told(boards, drivers, connected, caplog):
    true = GravityCalibration((1.60, 1.68, 1.75), (0.0345, 0.033, 0.0325), 0.02)
    save_calibration("adxl335", "bench-3", true.as_dict())
    sensor = connected(drivers(boards(calibration=true), serial="bench-3"))
    sensor.calibrate()
    got = read_some(sensor, 200)
    assert sum(r.value[2] for r in got) / len(got) == pytest.approx(GRAVITY_M_S2, abs=0.05)
    assert not caplog.records
    another = connected(drivers(boards(), serial="bench-3"))
    another.calibrate()
    (message,) = [r.getMessage() for r in caplog.records]
    assert "the calibration stored for bench-3 does not fit" in message
    connected(drivers(boards(), supply_v=1.8)).calibrate()
    assert "it is not calibrated, and the options for supply" in caplog.text


def opened(board):
    """How often this process has the board's port open."""
    port = Path(board.path).resolve()
    return [file.resolve() for file in Path("/proc/self/fd").iterdir()].count(port)


@pytest.mark.skipif(sys.platform != "linux", reason="open files are listed as on Linux")
def test_a_stored_calibration_that_cannot_be_read_leaves_the_port_closed(boards, drivers):
    file = calibration_file("adxl335", "bench-3")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("{")
    board = boards()
    before = opened(board)
    check_refused(drivers(board, serial="bench-3").connect, "the calibration .* cannot be read")
    assert opened(board) == before
