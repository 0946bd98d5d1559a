"""Two drivers on one LabJack U6: one stream, each its own inputs, lost and found together."""

import math
from itertools import pairwise

import numpy as np
import pytest
from driver_fixtures import own_calibrations  # noqa: F401 - a fixture
from nano17_files import write_calibration
from running_source import RunningSource
from sensor_reading import read_some, read_until, read_until_fault, read_until_lost
from test_labjack import REMOTE, inputs, level
from waiting import check_refused, until

from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.devices import board_sharing
from mmt.devices.adxl335.gravity import GRAVITY_M_S2, nominal
from mmt.devices.drivers import load_device
from mmt.testing.emulated.labjack_u6 import EmulatedU6, EmulatedU6Voltages

WAVE_HZ = 5.0
GAUGES, AXES = (4, 6, 8, 10, 12, 13), (1, 2, 3)


def test_two_readers_have_one_stream_and_each_its_own_inputs(closing):
    box = EmulatedU6(level)
    first = closing(inputs(5, 3, backend=box))
    second = closing(inputs(0, 7, 1, backend=box))
    first.connect()
    before = read_some(first, 20)
    second.connect()
    assert first.serial == second.serial == "u6-360000001"
    assert len(box.table) == 5
    here, there = read_some(first, 40), read_some(second, 40)
    stamps = [t for t, _ in before + here]
    assert stamps == [1_000_000 * k for k in range(len(stamps))]  # it was not interrupted
    assert {t for t, _ in here} & {t for t, _ in there}
    for readings, numbers in ((here, (5, 3)), (there, (0, 7, 1))):
        for _, volts in readings:
            assert volts == pytest.approx([0.1 * n for n in numbers], abs=0.0025)


def test_a_reader_comes_and_goes_without_disturbing_the_other(connected):
    box = EmulatedU6(level)
    first = connected(inputs(1, backend=box))
    read_some(first, 10)
    second = connected(inputs(2, backend=box))  # made when the stream runs already
    assert read_some(second, 10)[0].volts == pytest.approx([0.2], abs=0.0025)
    assert read_some(first, 10)[-1].volts == pytest.approx([0.1], abs=0.0025)
    first.close()
    check_refused(first.read, "is not open", DeviceLost)
    readings = read_some(second, 30)
    assert all(b.time_ns - a.time_ns == 1_000_000 for a, b in pairwise(readings))
    first.connect()
    assert read_some(first, 5)[0].time_ns > readings[-1].time_ns
    second.close()
    assert box.streaming
    first.close()
    assert not box.streaming


def test_what_one_stream_cannot_do_is_refused_and_the_other_goes_on(connected):
    box = EmulatedU6(level)
    gauges = connected(inputs(*range(0, 12, 2), backend=box, differential=True))
    for wrong, words in (
        (inputs(12, 13, 0, backend=box), "the others take 12 of its 14 inputs .* 3 more do not"),
        (inputs(11, backend=box), "input 11 belongs to another driver already: choose from 12, 13"),
        (inputs(12, backend=box, rate_hz=2000.0), "2000 scans a second, another for 1000"),
    ):
        check_refused(wrong.connect, f"shared by 2 drivers: .*{words}", InputError)
        wrong.close()
    read_some(gauges, 20)
    gauges.close()
    connected(inputs(*range(9), backend=box, rate_hz=4000.0))
    with pytest.raises(InputError, match="56000 samples a second are more than its 50000"):
        inputs(*range(9, 14), backend=box, rate_hz=4000.0).connect()


def test_faults_of_the_board_are_told_to_both(connected):
    box = EmulatedU6(level)
    first, second = (connected(inputs(number, backend=box)) for number in (1, 2))
    read_some(first, 5)
    read_some(second, 5)
    box.flip(2)
    read_until(first, lambda _: first.faults["bad packets"] == 2)
    read_some(second, 5)
    assert first.faults == second.faults
    box.unplug()
    for reader in (first, second):
        read_until_lost(reader, "plug it in again")
        check_refused(reader.connect, "there is no LabJack U6 on USB")
    box.plug()
    first.connect()
    assert read_some(first, 5)[0].time_ns == 0
    second.connect()
    assert read_some(second, 5)
    assert len(box.table) == 2
    box.stall()
    until(lambda: not first._shared.stream.is_streaming)  # which no reader can see
    first.connect()  # the first to connect begins it anew
    assert read_some(first, 5)
    assert read_some(second, 5)


def test_a_driver_that_lets_its_readings_lie_holds_up_nobody(connected, monkeypatch):
    monkeypatch.setattr(board_sharing, "_MOST_WAITING", 50)
    box = EmulatedU6(level)
    first, lazy = (connected(inputs(number, backend=box)) for number in (0, 1))
    read_some(first, 120)
    assert len(lazy.read()) <= 51
    assert lazy.faults["lost scans"] >= 60
    assert not first.faults


class TwoBoxes:
    """Two U6 on one bus: passes on to theirs what each is asked."""

    def __init__(self, *boxes):
        self._boxes = boxes
        self._owner = {}

    def enumerate_devices(self):
        return list(self._boxes)

    def open_device(self, dev):
        handle = dev.open_device(dev)
        self._owner[handle] = dev
        return handle

    def __getattr__(self, name):
        return lambda which, *rest: getattr(self._owner.get(which, which), name)(which, *rest)


def test_two_boxes_are_told_apart_by_their_numbers(connected):
    bus = TwoBoxes(EmulatedU6(level, serial=7), EmulatedU6(lambda _: [3.0] * 14, serial=8))
    check_refused(inputs(0, backend=bus).connect, "there are 2 LabJack U6: say which one")
    with pytest.raises(MmtError, match=r"serial number 9 on USB: .*there is 7; there is 8"):
        inputs(0, backend=bus, box=9).connect()
    first = connected(inputs(1, backend=bus, box=7))
    second = connected(inputs(1, backend=bus, box=8, rate_hz=2000.0))
    assert read_some(first, 10)[-1].volts == pytest.approx([0.1], abs=0.0025)
    assert read_some(second, 10)[-1].volts == pytest.approx([3.0], abs=0.0025)
    check_refused(inputs(3, backend=bus).connect, "say which one by the option 'box'")
    assert read_some(first, 10)


class Bench(RunningSource):
    """An emulated U6 that carries six gauges and an accelerometer, and a source on both."""

    def __init__(self, tmp_path):
        self.pressed = False
        self.replaced_v = {}
        """Voltages of inputs that measure something else."""
        self.box = EmulatedU6Voltages.at = EmulatedU6(self._volts, clock_ppm=60.0)
        file = write_calibration(tmp_path)
        board = {**REMOTE, "inputs": GAUGES}
        self.gauges = load_device("ati-gauges", {"calibration_file": file, "board": board})
        options = {"board": {**board, "inputs": AXES}, "bandwidth_hz": 1600.0}
        self.accelerometer = load_device("adxl335-board", options)
        super().__init__(self.gauges, self.accelerometer)

    def force_n(self, time_ns):
        return 2.0 + np.sin(2e-9 * math.pi * WAVE_HZ * time_ns)

    def acceleration_m_s2(self, time_ns):
        return GRAVITY_M_S2 + 3.0 * np.cos(2e-9 * math.pi * WAVE_HZ * time_ns)

    def _volts(self, time_ns):
        tremor = 2e-3 * (time_ns // 1_000_000 % 2)
        zero_v, gain, _ = nominal(3.3)
        force = self.force_n(time_ns) if self.pressed else 0.0
        felt = (0.0, 0.0, self.acceleration_m_s2(time_ns) if self.pressed else GRAVITY_M_S2)
        volts = dict.fromkeys(GAUGES, 0.2 + tremor)
        volts[GAUGES[2]] += 0.5 * force
        for k, number in enumerate(AXES):
            volts[number] = zero_v[k] + gain[k] * felt[k] + tremor
        volts |= self.replaced_v
        return [volts.get(number, 0.0) for number in range(14)]


@pytest.fixture
def bench(tmp_path, started):
    made = started(Bench(tmp_path))
    made.pressed = True
    made.run(lambda number: number >= 50)  # some are still from before
    yield made
    made.source.close()
    assert not made.box.streaming


def test_one_box_carries_the_gauges_and_the_accelerometer_into_frames_of_1_khz(bench):
    frames = bench.run(lambda number: number >= 600)
    assert len(bench.box.table) == 9
    assert np.median(np.diff(frames["time_ns"])) == pytest.approx(1e6, abs=1e4)
    assert (np.diff(frames["sequence"].astype(int)) > 0).all()
    t = frames["time_ns"]
    force = frames["force_n"][:, 2] - bench.force_n(t)
    felt = frames["acceleration_m_s2"][:, 2] - bench.acceleration_m_s2(t)
    # A millisecond is 0.03 N and 0.1 m/s2 here; counts and tremor are 0.005 N, 0.06 m/s2.
    assert np.sqrt(np.mean(force**2)) < 0.05
    assert abs(frames["force_n"][:, 2].mean() - bench.force_n(t).mean()) < 0.01
    assert np.sqrt(np.mean(felt**2)) < 0.25
    assert abs(frames["force_n"][:, :2]).max() < 0.02
    assert bench.told == []
    summary = bench.source.summary
    assert summary["force_sensor"]["drift_ppm"] == pytest.approx(
        summary["accelerometer"]["drift_ppm"], abs=500.0
    )


def test_an_unplugged_or_spoilt_box_is_two_lost_sensors_which_both_come_back(bench):
    bench.box.unplug()
    gone = "the LabJack U6 is gone: plug it in again"
    bench.run_until_told(f"force sensor.* {gone}", f"accelerometer.* {gone}")
    bench.box.plug()
    bench.run(lambda _: not bench.is_lost)
    frames = bench.run(lambda number: number >= 200)
    assert np.median(abs(frames["force_n"][:, 2] - bench.force_n(frames["time_ns"]))) < 0.1
    assert bench.gauges.loaded.serial == "FT7"
    bench.box.flip(10**9)  # it sends garbage alone
    bench.run_until_told("force sensor.* no reading for", "accelerometer.* no reading for")
    bench.box.flip(0)
    bench.run(lambda _: not bench.is_lost)
    assert len(bench.run(lambda number: number >= 50)) >= 50
    bench.replaced_v = {GAUGES[2]: 10.5, AXES[2]: 3.2}  # an input beyond its range; 4.7 g
    for sensor, fault in ((bench.gauges, "saturation"), (bench.accelerometer, "overload")):
        read_until_fault(sensor, fault, 5)
        assert any(kind.endswith("bad packets") for kind in sensor.faults)
    assert "saturation" not in bench.accelerometer.faults
