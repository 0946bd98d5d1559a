"""The ``.cal`` file, and forces from gauge voltages on an emulated board."""

import itertools
import math
import random
import re
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_reading import read_some, read_until_fault, read_until_lost
from waiting import check_refused

from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.devices.ati.gauges import (
    load_calibration_file,
    parse_calibration_file,
)
from mmt.devices.drivers import load_device
from mmt.devices.protocols import VoltageReading

NAMES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
ROWS = np.array(
    [
        [0.02, -0.03, 0.05, 1.7, 0.04, -1.7],
        [0.1, -2.0, 0.03, 1.0, -0.06, 1.1],
        [1.9, 0.05, 1.8, -0.02, 1.85, 0.01],
        [0.2, -0.1, 11.0, 0.3, -11.2, 0.2],
        [-12.5, 0.4, 6.1, -0.1, 6.3, 0.2],
        [0.3, -7.5, 0.1, -7.4, 0.2, -7.6],
    ]
)
"""N and N mm a volt."""
FORCE = (0.5, -0.25, 2.0)


def values(row):
    return " ".join(f"{value:.9g}" for value in row)


def cal_file(
    axes=None, *, units=("N", "N-mm", "mm"), head="", ranges=(12, 12, 17, 120, 120, 120), gain="1"
):
    axes = axes or "".join(
        f'<UserAxis Name="{name}" values=" {values(row)} " max="{limit}"/>'
        for name, row, limit in zip(NAMES, ROWS, ranges, strict=True)
    )
    force, torque, length = units
    return (
        f'{head}<FTSensor Serial="FT00019" BodyStyle="Nano17" Family="DAQ" NumGages="6" '
        f'CalFileVersion="1.1"><Calibration PartNumber="SI-12-0.12" CalDate="1/2/2024" '
        f'ForceUnits="{force}" TorqueUnits="{torque}" DistUnits="{length}" OutputRange="20" '
        f'GainMultiplier="{gain}" OutputBipolar="True">{axes}</Calibration></FTSensor>'
    ).encode()


def test_the_user_axes_are_the_matrix():
    head = '<?xml version="1.0" encoding="utf-8"?><!-- a note -->'
    loaded = parse_calibration_file(cal_file(head=head))
    np.testing.assert_allclose(loaded.matrix, ROWS)
    assert (loaded.serial, loaded.part, loaded.force_unit) == ("FT00019", "SI-12-0.12", "N")
    assert loaded.limits == (12.0, 12.0, 17.0, 120.0, 120.0, 120.0)
    assert loaded.output_v == 10.0


def test_what_a_file_leaves_out_has_its_usual_value_and_other_units_are_converted():
    whole = cal_file(ranges=(0.5, 1, 1, 1, 1, 1))
    for usual in (b' OutputRange="20"', b' GainMultiplier="1"', b' OutputBipolar="True"'):
        assert parse_calibration_file(whole.replace(usual, b"")) == parse_calibration_file(whole)
    nameless = re.sub(rb' (Serial|PartNumber)="[^"]*"', b"", cal_file())
    loaded = parse_calibration_file(nameless.replace(b'"True"', b'"False"'))
    assert (loaded.serial, loaded.part, loaded.output_v) == ("", "", 20.0)
    loaded = parse_calibration_file(cal_file(units=("lbf", "lbf-in", "in")))
    np.testing.assert_allclose(loaded.matrix[0], 4.4482216152605 * ROWS[0])
    np.testing.assert_allclose(loaded.matrix[5], 4.4482216152605 * 25.4 * ROWS[5])


@pytest.mark.parametrize(
    ("units", "millimetres_a_unit", "newton", "newton_mm"),
    [(("N", "N-mm", "mm"), 1, 1, 1), (("kN", "N-m", "m"), 1e3, 1e3, 1e3)],
)
def test_a_file_without_user_axes_gives_the_matrix_at_the_displaced_origin(
    units, millimetres_a_unit, newton, newton_mm
):
    displaced = np.array([0.3, -0.2, 6.096])
    scales = np.array([11.4, 11.4, 5.9, 1.0, 1.8, 1.6])
    axes = "".join(
        f'<Axis Name="{name}" values="{values(row * scale)}" max="12" scale="{scale}"/>'
        for name, row, scale in zip(NAMES, ROWS, scales, strict=True)
    )
    dx, dy, dz = displaced / millimetres_a_unit
    forces, torques = newton * ROWS[:3], newton_mm * ROWS[3:]
    for moves, by in (
        (f'<BasicTransform Dx="{dx}" Dy="{dy}" Dz="{dz}" Rx="0" Ry="0" Rz="0"/>', displaced),
        ("", (0, 0, 0)),
        ("<BasicTransform/>", (0, 0, 0)),
    ):
        loaded = parse_calibration_file(cal_file(axes + moves, units=units))
        moved = torques - np.cross(by, forces.T).T
        np.testing.assert_allclose(loaded.matrix[:3], forces, rtol=1e-7)
        np.testing.assert_allclose(loaded.matrix[3:], moved, rtol=1e-6)
    for wrong, words in (
        (axes.replace('"1.0"', '"0"'), "scale of Tx is zero"),
        (axes.replace(' scale="11.4"', ""), "scale of Fx is '', not a finite number"),
        (axes + '<BasicTransform Rx="1"/>', "BasicTransform turns the axes"),
        (axes + '<BasicTransform Ry="1"/>', "BasicTransform turns the axes"),
        (axes + '<BasicTransform Rz="1"/>', "BasicTransform turns the axes"),
    ):
        with pytest.raises(InputError, match=words):
            parse_calibration_file(cal_file(wrong, units=units))
    with pytest.raises(InputError, match="the file: the unit of length 'stone'"):
        parse_calibration_file(cal_file(axes + moves, units=(*units[:2], "stone")))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "it is no XML"),
        (b"<html><Calibration/></html>", "no .cal file by ATI"),
        (cal_file("<Nothing/>"), "neither UserAxis nor Axis"),
        (cal_file('<UserAxis Name="Fx" values="1 2 3 4 5 6" max="1"/>'), "no UserAxis for Fy, Fz"),
        (cal_file().replace(b"0.02 ", b"", 1), "Fx has 5 values, six are expected"),
        (cal_file().replace(b"0.02 ", b"x ", 1), "values of Fx is 'x', not a finite number"),
        (cal_file(ranges=(0, 1, 1, 1, 1, 1)), "not above zero"),
        (cal_file(units=("stone", "N-mm", "mm")), "the file: the unit of force 'stone'"),
        (cal_file(units=("N", "stone", "mm")), "the file: the unit of torque 'stone'"),
        (cal_file().replace(b' max="17"', b""), "max of Fz is '', not a finite number"),
        (cal_file(units=("kN", "N-mm", "m")).replace(b"0.02 ", b"1e308 "), "matrix cannot be used"),
        (cal_file(units=("", "N-mm", "mm")), "has no ForceUnits"),
        (cal_file(gain="2"), "GainMultiplier is not 1"),
    ],
)
def test_a_file_that_cannot_be_used_is_explained(content, words):
    with pytest.raises(InputError, match=words):
        parse_calibration_file(content)


@given(st.integers(min_value=0), st.sampled_from([b"nan", b"-inf", b"inf", b"1e400"]))
def test_every_number_of_a_file_must_be_finite(place, word):
    head, output, rest = cal_file().partition(b"OutputRange=")
    numbers = list(re.finditer(rb"(?<=[\" ])-?[\d.]+(?=[\" ])", rest))
    begin, end = numbers[place % len(numbers)].span()
    key = "(max|values) of [FT][xyz]|OutputRange|GainMultiplier"
    with pytest.raises(InputError, match=f"its ({key}) is '.*', not a finite number"):
        parse_calibration_file(head + output + rest[:begin] + word + rest[end:])


def test_a_file_that_is_missing_or_too_large_is_explained(tmp_path):
    with pytest.raises(InputError, match=r"none.cal: No such file"):
        load_calibration_file(tmp_path / "none.cal")
    large = tmp_path / "large.cal"
    large.write_bytes(cal_file().ljust(1 << 20))
    assert load_calibration_file(large).output_v == 10.0
    for content, words in ((cal_file().ljust((1 << 20) + 1), "over 1 MiB"), (b"", "it is no XML")):
        large.write_bytes(content)
        with pytest.raises(InputError, match=rf"calibration .*large.cal: {words}"):
            load_calibration_file(large)


class EmulatedGauges:
    """A `VoltageBoard` whose gauges feel the force that is true at a time (ns of the host)."""

    inputs, latency_ns, limit_v = 6, 0, 10.0

    def __init__(self, truth):
        self.truth = truth
        self.stuck = self.silent = False
        self.faults = {}
        self.began_ns = time.monotonic_ns()
        self._noise_v = random.Random(1)
        self._volts, self._sent = (0.0,) * 6, 0

    def connect(self):
        self._sent = self._due()

    def close(self): ...

    def read(self):
        first, self._sent = self._sent, self._due()
        numbers = range(first + 1, self._sent + 1)
        return () if self.silent else [self._sample(number) for number in numbers]

    def _due(self):
        return (time.monotonic_ns() - self.began_ns) // 1_000_000

    def _sample(self, number):
        if not self.stuck:
            force_n = self.truth(self.began_ns + number * 1_000_000)
            volts = np.linalg.inv(ROWS)[:, :3] @ force_n + 0.2 + self._noise_v.gauss(0.0, 1e-4)
            self._volts = tuple(np.clip(volts, -self.limit_v, self.limit_v).tolist())
        return VoltageReading(number * 1_000_000, self._volts)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "FT00019.cal"
    path.write_bytes(cal_file())
    return path


def made_already(board):
    return board


def make(file, board, **options):
    table = {"driver": f"{__name__}:made_already", "board": board}
    return load_device("ati-gauges", {"calibration_file": file, "board": table, **options})


@pytest.fixture
def board():
    return EmulatedGauges(lambda _time_ns: FORCE)


@pytest.fixture
def sensor(file, board, connected):
    return connected(make(file, board))


def test_the_bias_is_taken_off_and_the_clock_is_the_boards(board, sensor):
    """Voltages that are no numbers make no bias."""
    board.truth = lambda time_ns: (0.0, 0.0 if time_ns // 5_000_000 % 2 else math.nan, 0.0)
    sensor.read()
    sensor.calibrate()
    board.truth = lambda _time_ns: FORCE
    sensor.read()
    readings = read_some(sensor, 100)
    assert all(reading.value == pytest.approx(FORCE, abs=0.01) for reading in readings)
    steps = {b.time_ns - a.time_ns for a, b in itertools.pairwise(readings)}
    assert steps == {1_000_000}


def test_the_stamp_is_the_instant_of_the_force(file, connected):
    board = EmulatedGauges(lambda time_ns: (0.0, 0.0, math.sin(40e-9 * time_ns)))
    readings = read_some(connected(make(file, board)), 300)
    z = np.array([reading.value[2] for reading in readings])
    times_s = 1e-9 * (board.began_ns + np.array([reading.time_ns for reading in readings]))
    expected = np.sin(40.0 * times_s)
    np.testing.assert_allclose(z - z.mean(), expected - expected.mean(), atol=0.02)


def test_the_calibration_is_checked(file, board):
    with pytest.raises(InputError, match="its serial number is FT00019, expected is FT1"):
        make(file, board, serial="FT1")
    board.inputs = 4
    check_refused(lambda: make(file, board), "set to 4 inputs, the gauges need six", InputError)


def test_overload_saturation_and_broken_voltages_are_counted(board, sensor):
    board.truth = lambda _time_ns: (0.0, 0.0, 20.0)
    read_until_fault(sensor, "overload", 5)
    board.truth = lambda _time_ns: (0.0, 0.0, 80.0)
    read_until_fault(sensor, "saturation", 5)
    board.truth = lambda _time_ns: (0.0, math.nan, 0.0)
    read_until_fault(sensor, "impossible value", 5)
    assert "check the transducer's cable, and that calibration" in sensor.explain_fault()


@pytest.mark.parametrize("gauge", range(6))
@pytest.mark.parametrize(("volts", "saturated"), [(9.5, 0), (-9.5, 0), (9.9, 1), (-9.9, 1)])
def test_each_gauge_saturates_at_either_end(board, sensor, gauge, volts, saturated):
    raw = [0.0] * 6
    raw[gauge] = volts
    sensor.read()
    board.read = lambda: [VoltageReading(10**12, tuple(raw))]
    sensor.read()
    assert sensor.faults.get("saturation", 0) == saturated
    sensor.close()
    check_refused(sensor.read, r"gauges by FT00019.cal is closed: connect it again", DeviceLost)


def test_silence_stuck_voltages_and_the_boards_own_faults_are_told(board, sensor):
    board.faults = {"bad checksum": 3}
    assert sensor.faults["board: bad checksum"] == 3
    board.stuck = True
    read_until_lost(sensor, "the very same values")
    board.silent = True
    read_until_lost(sensor, "no record for")
    check_refused(sensor.connect, "the board gives no voltages")


def board_of_a_lab(*, amplified):
    assert amplified
    return EmulatedGauges(lambda _time_ns: FORCE)


def test_the_board_is_made_by_its_own_driver(file, connected):
    table = {"driver": f"{__name__}:board_of_a_lab", "amplified": True}
    options = {"calibration_file": str(file), "board": table}
    assert read_some(connected(load_device("ati-gauges", options)), 5)


class HalfOpened(EmulatedGauges):
    """A board that cannot be connected, yet holds what `close` must release."""

    holds = False

    def connect(self):
        self.holds = True
        raise MmtError("the board does not answer")

    def close(self):
        self.holds = False


def test_a_board_that_cannot_be_connected_is_closed(file):
    board = HalfOpened(lambda _time_ns: FORCE)
    sensor = make(file, board)
    check_refused(sensor.connect, "the board does not answer")
    assert not board.holds


def test_a_driver_imports_neither_scipy_nor_numba():
    program = (
        "import sys, mmt.devices.ati.net_ft, mmt.devices.ati.digital_ft, mmt.devices.ati.gauges;"
        "sys.exit(bool({'scipy', 'numba', 'asyncio'} & set(sys.modules)))"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=150)
