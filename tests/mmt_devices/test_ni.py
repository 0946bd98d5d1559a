"""A board by NI, emulated beneath NI's own package: gauges and an accelerometer in one task."""

import math
import re
import time
import tomllib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from driver_fixtures import own_calibrations  # noqa: F401 - a fixture
from hypothesis import given
from hypothesis import strategies as st
from nano17_files import write_calibration
from running_source import RunningSource
from sensor_reading import read_some, read_until_fault, read_until_lost
from waiting import check_refused

from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.core.frames import acceleration_samples
from mmt.devices.adxl335.gravity import GRAVITY_M_S2, nominal
from mmt.devices.discovery import FoundPort
from mmt.devices.drivers import load_device
from mmt.testing.emulated.drivers import LAB

pytest.importorskip("nidaqmx", reason="nidaqmx is not installed: pip install -e '.[ni]'")

import nidaqmx._lib
from nidaqmx.errors import DaqError

from mmt_devices.ni import daqmx, driver
from mmt_devices.ni.driver import NiOptions, NiVoltages
from mmt_devices.ni.emulated import INPUTS, EmulatedNi

PAGE = Path(__file__).parents[2] / "docs/how-to/ni.md"
LEVELS = 0.1 * np.arange(INPUTS)


def level(times_ns):
    return np.tile(LEVELS, (len(times_ns), 1))


def inputs(*numbers, backend, **options):
    return NiVoltages(NiOptions(inputs=numbers, **options), backend)


class BenchBoard(NiVoltages):
    """The driver at an emulated board, which is set before it is made."""

    def __init__(self, options):
        super().__init__(options, self.at)


def test_inputs_are_measured_against_ground_or_their_partners_at_the_boards_rate(connected):
    box = EmulatedNi(level)
    reader = connected(inputs(3, 0, backend=box, rate_hz=3000.0))
    single = connected(inputs(14, 6, backend=box, terminals="rse", rate_hz=3000.0))
    assert box.channels == 4  # in one task
    assert reader.serial == single.serial == "ni-1A2B3C"
    readings, others = read_some(reader, 300), read_some(single, 300)
    assert np.mean([volts for _, volts in readings], axis=0) == pytest.approx([-0.8] * 2, abs=1e-3)
    assert np.mean([volts for _, volts in others], axis=0) == pytest.approx([1.4, 0.6], abs=1e-3)
    stamps = np.array([time_ns for time_ns, _ in readings])
    assert np.diff(stamps) == pytest.approx(6666 / 20e6 * 1e9, abs=1)  # the next rate it has
    assert {time_ns for time_ns, _ in others} & set(stamps.tolist())
    assert reader.faults == {}


def test_the_thread_waits_the_reader_does_not_and_what_it_does_not_take_is_counted(
    connected, monkeypatch
):
    reader = connected(inputs(0, backend=EmulatedNi(level), rate_hz=100.0))
    read_some(reader, 3)
    began_ns = time.thread_time_ns()
    for _ in range(20):
        reader.read()
    assert time.thread_time_ns() - began_ns < 10_000_000
    assert 0 <= time.monotonic_ns() - reader.arrival_ns < 5_000_000_000
    monkeypatch.setattr("mmt_devices.ni.stream._MOST_WAITING", 20)
    time.sleep(0.5)
    read_until_fault(reader, "lost scans")


def test_a_board_that_is_read_too_late_says_so_and_goes_on(connected, caplog):
    box = EmulatedNi(level)
    reader = connected(inputs(0, 1, backend=box))
    before = read_some(reader, 50)
    box.lag(10_000)  # of a buffer of 4000
    after = read_until_fault(reader, "overruns")
    after += read_some(reader, 50)
    assert "was read too late" in caplog.text
    assert reader.faults["overruns"] == 1
    steps = [b.time_ns - a.time_ns for a, b in pairwise([*before, *after])]
    assert min(steps) == 500_000
    lost = reader.faults["lost scans"]
    assert sum(steps) == 500_000 * (len(steps) + lost)


def test_an_unplugged_board_is_lost_and_comes_back(connected):
    box = EmulatedNi(level)
    reader, other = (connected(inputs(number, backend=box)) for number in (0, 1))
    box.plugged = False
    for each in (reader, other):
        read_until_lost(each, r"NI Dev1 is gone: Device cannot be .*-201003")
        check_refused(each.connect, "there is no board by NI: plug it in; there is none")
    box.plugged = True
    for each in (reader, other):
        each.connect()
        assert read_some(each, 5)
    assert box.channels == 2
    other.close()
    box.stalled = True
    read_until_lost(reader, "have not yet been acquired")
    box.stalled = False
    reader.connect()
    assert read_some(reader, 5)
    reader.close()
    check_refused(reader.read, "is not open", DeviceLost)


def test_what_one_task_cannot_do_is_refused_and_the_other_goes_on(connected):
    box = EmulatedNi(level)
    first = connected(inputs(0, 1, backend=box))
    for wrong, words in (
        (inputs(1, 2, backend=box), "shared by 2 drivers: ai1 belongs to another driver"),
        (inputs(2, backend=box, rate_hz=1000.0), "1000 scans a second, another for 2000"),
        (inputs(2, 40, backend=box), "Dev1 has no ai40, but 16 inputs from ai0 on"),
    ):
        check_refused(wrong.connect, words, InputError)
    with pytest.raises(MmtError, match="AI_TermCfg Possible Values: DAQmx_Val_RSE"):
        (refused := inputs(9, backend=box)).connect()
    first.close()
    first.connect()
    assert read_some(first, 5), f"without {refused.channels}"
    first.close()
    with pytest.raises(InputError, match=r"1100000 samples a second .* 1000000 that Dev1 \(USB-62"):
        inputs(*range(22), backend=Larger(level), rate_hz=50_000.0).connect()


class Larger(EmulatedNi):
    """With more inputs."""

    def get_device_attribute_string(self, device_name, attribute):
        said = super().get_device_attribute_string(device_name, attribute)
        return said if attribute == 0x631 else f"{said}, {device_name}/ai16:31"


def test_which_board_is_told_where_there_are_several_or_another_program_has_it(connected):
    box = EmulatedNi(level)
    box.name = "Dev1, Dev2"
    with pytest.raises(InputError, match=r"2 boards by NI: .*'device': Dev1 \(USB-6251\), Dev2"):
        inputs(0, backend=box).connect()
    with pytest.raises(MmtError, match=r"no board by NI named Dev7: .* Dev2 \(USB-6251\)"):
        inputs(0, backend=box, device="Dev7").connect()
    second = connected(inputs(0, backend=box, device="Dev2"))
    assert read_some(second, 5)
    taken = EmulatedNi(level)
    task = taken.task()
    task.start()
    check_refused(inputs(0, backend=taken).connect, "another program has it: close that one")
    task.close()


def test_boards_are_listed_and_a_missing_driver_is_told(monkeypatch):
    assert daqmx.find_ports(EmulatedNi(level)) == [FoundPort("Dev1", "USB-6251", "1A2B3C", "")]
    monkeypatch.setattr("nidaqmx._library_interpreter.lib_importer", nidaqmx._lib.DaqLibImporter())
    monkeypatch.setattr("nidaqmx._lib.find_library", lambda _name: None)
    assert re.search(r"NI-DAQmx, which is not installed; .* -m nidaqmx inst", driver.missing())
    check_refused(load_device("ni-daqmx").connect, "NI-DAQmx, which is not installed")


ANYTHING = st.one_of(
    st.none(), st.booleans(), st.integers(-5, 300), st.floats(), st.text(max_size=8),
    st.sampled_from(["rse", "differential", "Dev1"]), st.lists(st.integers(-2, 260), max_size=40),
)  # fmt: skip


@given(st.dictionaries(st.sampled_from([*NiOptions.model_fields, "foo"]), ANYTHING))
def test_any_options_are_taken_in_their_bounds_or_refused_by_name(options):
    try:
        board = load_device("ni-daqmx", options)
    except InputError as error:
        refused = str(error)
    else:
        refused = ""
    if refused:
        assert any(name in refused for name in options)
        return
    assert 1 <= board.inputs <= 32
    assert 100.0 <= board.rate_hz <= 50_000.0
    assert 0.05 <= board.limit_v <= 10.0
    assert all(0 <= number <= 255 for number, _, _ in board.channels)
    assert len(set(board.channels)) == board.inputs


@given(st.text(), st.integers(-300_000, -1))
def test_any_error_of_ni_daqmx_is_one_line(text, code):
    said = daqmx.explain(DaqError(f"It failed.\n\n{text}\n\nTask Name: _unnamedTask<0>", code))
    assert len(said.splitlines()) == 1
    assert code == -50103 or said.startswith("It failed.")


def test_the_page_has_every_option_and_its_scene_loads(tmp_path):
    page = PAGE.read_text(encoding="utf-8")
    assert all(f"`{option}`" in page for option in NiOptions.model_fields)
    (block,) = re.findall(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    tables = tomllib.loads(block)["devices"]
    tables["force_sensor"]["calibration_file"] = str(write_calibration(tmp_path))
    boards = []
    for role, table in tables.items():
        load_device(table["driver"], {k: v for k, v in table.items() if k != "driver"}, role=role)
        boards.append(load_device(table["board"].pop("driver"), table["board"], role="board"))
    assert [number for board in boards for number, _, _ in board.channels] == [*range(8), 14]
    assert len({board.rate_hz for board in boards}) == 1


class Bench(RunningSource):
    """An emulated board that carries six gauges and an accelerometer, and a source on both."""

    def __init__(self, tmp_path, rate_hz, samples, fast_hz):
        self.pressed, self._fast_hz = False, fast_hz
        self.box = BenchBoard.at = EmulatedNi(self._volts, clock_ppm=60.0)
        common = {"driver": f"{__name__}:BenchBoard", "rate_hz": rate_hz}
        file = write_calibration(tmp_path)
        gauges = load_device("ati-gauges", {"calibration_file": file, "board": common})
        board = {**common, "inputs": [6, 7, 14], "terminals": "rse"}
        self.accelerometer = load_device("adxl335-board", {"board": board, "bandwidth_hz": 1600})
        super().__init__(gauges, self.accelerometer, samples_per_frame=samples)

    def force_n(self, times_ns):
        return 2.0 + np.sin(10e-9 * math.pi * times_ns)

    def acceleration_m_s2(self, times_ns):
        slow, fast = (math.tau * f * times_ns * 1e-9 for f in (20.0, self._fast_hz))
        felt = [10.0 * np.sin(slow), 5.0 * np.sin(fast), np.full(len(times_ns), GRAVITY_M_S2)]
        return np.array(felt).T

    def _volts(self, times_ns):
        times = np.array(times_ns)
        volts = np.zeros((len(times), INPUTS))
        zero, gain, _ = nominal(3.3)
        if self.pressed:
            volts[:, 2] = 0.5 * self.force_n(times)
        delayed = times - self.accelerometer.latency_ns  # by the sensor's own filter
        volts[:, [6, 7, 14]] = zero + gain * self.acceleration_m_s2(delayed)
        return volts


@pytest.mark.parametrize(
    ("rate_hz", "samples", "fast_hz"), [(2000.0, 1, 300.0), (6000.0, 5, 1300.0)]
)
def test_one_board_carries_gauges_and_accelerometer_into_frames(
    tmp_path, started, rate_hz, samples, fast_hz
):
    bench = started(Bench(tmp_path, rate_hz, samples, fast_hz))
    bench.pressed = True
    bench.run(lambda number: number >= 50)  # some are still from before
    frames = bench.run(lambda number: number >= 600)
    assert bench.box.channels == 9
    assert np.median(np.diff(frames["time_ns"])) == pytest.approx(1e6, abs=1e4)
    times = frames["time_ns"]
    assert np.median(abs(frames["force_n"][:, 2] - bench.force_n(times))) < 0.05
    assert abs(frames["force_n"][:, :2]).max() < 0.02
    earlier_ns = np.arange(1 - samples, 1) * (1_000_000 / samples)
    expected = bench.acceleration_m_s2((times[:, np.newaxis] + earlier_ns).ravel())
    x, y, z = acceleration_samples(frames).T.astype(float)
    assert np.median(abs(x - expected[:, 0])) < 1.5  # a millisecond and a half
    assert np.std(y) == pytest.approx(np.std(expected[:, 1]), rel=0.15)
    assert np.median(z) == pytest.approx(GRAVITY_M_S2, abs=0.1)
    assert bench.told == []


def test_a_lab_that_ends_is_a_lost_board_which_comes_back(connected):
    board = connected(load_device("virtual-ni-daqmx", {"seed": 3}))
    assert np.mean([volts for _, volts in read_some(board)]) == pytest.approx(0.2, abs=1e-3)
    LAB.process.kill()
    read_until_lost(board, "The virtual lab has ended")
    board.connect()
    assert read_some(board)
