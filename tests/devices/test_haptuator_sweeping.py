"""A sweep that is played and felt: how loud, along which direction, and when it is ended."""

import math
from pathlib import Path

import numpy as np
import pytest
from command_runs import refusal, run_json
from synthetic_sensors import Time

from mmt.core.errors import InputError, MmtError
from mmt.devices.drivers import load_device
from mmt.devices.haptuator import sweep as sweeping
from mmt.devices.haptuator.equaliser import fit_equaliser
from mmt.devices.haptuator.sweep import SweepSettings, record_sweep
from mmt.devices.protocols import ActuatorStatistics, SensorReading
from mmt.testing.emulated.haptuator_board import EmulatedHaptuatorBoard

GAIN = 20.0
DELAY = 8.0
RATE_HZ = 1250
REST = np.array([0.3, -0.2, 9.8])
DIRECTION = np.array([0.6, 0.0, -0.8])


class Handle:
    """Actuator and accelerometer in one: a gain, a delay, and nothing else."""

    largest_v = 2.0

    def __init__(self, time, shape=lambda v: GAIN * v):
        self.time, self.shape = time, shape
        self.volts = []
        self.begun_ns = time.now_ns
        self.given = self.closed = 0

    def connect(self): ...

    calibrate = connect

    def close(self):
        self.closed += 1

    @property
    def statistics(self) -> ActuatorStatistics:
        return ActuatorStatistics(len(self.volts), 0, 0.0, 0.0)


class Coil(Handle):
    def write(self, samples_m_s2):
        raise AssertionError("voltages are played, no accelerations")

    def write_volts(self, volts):
        if not self.volts:
            self.begun_ns = self.time.now_ns
        late = (self.time.now_ns - self.begun_ns) // 1_000_000 - len(self.volts)
        self.volts += [0.0] * late + list(volts)

    def acceleration(self, time_ns):
        """Return what a band-limited converter makes of the voltages, `DELAY` ms late."""
        place = (time_ns - self.begun_ns) / 1e6 - DELAY
        first = math.floor(place)
        begin = max(0, first - 7)
        near = self.volts[begin : max(begin, first + 9)]
        if not any(near):
            return self.shape(0.0)
        apart = place - np.arange(begin, begin + len(near))
        weights = np.sinc(apart) * np.cos(np.clip(apart / 16 * np.pi, -np.pi / 2, np.pi / 2)) ** 2
        return self.shape(float(weights @ np.array(near)))


class Sensor(Handle):
    latency_ns = 0

    def __init__(self, time, coil, rate_hz=RATE_HZ):
        super().__init__(time)
        self.coil, self.rate_hz = coil, rate_hz
        self.faults = {}
        self.noise = np.random.default_rng(1)

    def read(self):
        due = int((self.time.now_ns - self.begun_ns) * 1e-9 * self.rate_hz)
        come = []
        for number in range(self.given, due):
            time_ns = round(number * 1e9 / self.rate_hz)
            value = REST + DIRECTION * self.coil.acceleration(self.begun_ns + time_ns)
            come.append(SensorReading(time_ns, tuple(value + self.noise.normal(0, 0.02, 3))))
        self.given = due
        return come or None


@pytest.fixture
def time(monkeypatch):
    made = Time()
    monkeypatch.setattr(sweeping, "time", made.still)
    return made


SHORT = SweepSettings(duration_s=2.0, largest_m_s2=8.0)


def test_the_level_is_found_quietly_and_what_is_felt_is_fitted(time):
    coil = Coil(time)
    sensor = Sensor(time, coil, rate_hz=2000)
    said = []
    recording = record_sweep(coil, sensor, SHORT, said.append)
    assert said[0] == "listening to a sweep of 1 s at 0.0625 V"
    assert recording.level_v == pytest.approx(0.8 * 8.0 / GAIN, rel=0.1)
    assert recording.peak_m_s2 < 8.0
    assert max(map(abs, coil.volts)) <= recording.level_v
    fitted = fit_equaliser(recording.volts, recording.acceleration_m_s2)
    assert fitted.volts_per_m_s2 == pytest.approx(1 / GAIN, rel=0.03)
    assert fitted.unevenness_db < 0.3
    assert fitted.coherence > 0.98
    assert (coil.closed, sensor.closed) == (1, 1)


def test_an_actuator_that_is_barely_felt_gets_its_limit_and_no_more(time, monkeypatch):
    monkeypatch.setattr(sweeping, "_PROBE_SHARE", 0.5)
    coil = Coil(time, lambda v: 0.8 * v)
    recording = record_sweep(coil, Sensor(time, coil), SHORT)
    assert recording.level_v == coil.largest_v
    assert max(map(abs, coil.volts)) <= coil.largest_v


def test_a_handle_that_is_shaken_too_hard_ends_the_sweep(time):
    coil = Coil(time, lambda v: v if abs(v) < 0.2 else 100.0 * v)  # it strikes something
    sensor = Sensor(time, coil)
    with pytest.raises(MmtError, match=r"ended: the handle is shaken by \d+"):
        record_sweep(coil, sensor, SweepSettings(duration_s=3.0, largest_m_s2=8.0, level_v=1.0))
    assert max(map(abs, coil.volts)) < 0.9  # it was faded in, and ended on the way
    assert (coil.closed, sensor.closed) == (1, 1)


@pytest.mark.parametrize(
    ("shape", "rate_hz", "kind", "words", "most_v"),
    [
        (lambda v: math.nan if v else 0.0, RATE_HZ, MmtError, "handle is shaken by nan", 0.0625),
        (lambda v: 0.0, RATE_HZ, MmtError, "feels nothing of 2 V: check that it sits", 2.0),
        (lambda v: GAIN * v, 800, InputError, "800 readings a second, too few for 490", 0.0625),
        (lambda v: GAIN * v, 0, MmtError, "no reading for 0.2 s", 0.0),
    ],
    ids=["no numbers", "feels nothing", "too slow", "silent"],
)
def test_an_accelerometer_that_is_of_no_use_ends_the_sweep(
    time, shape, rate_hz, kind, words, most_v
):
    coil = Coil(time, shape)
    sensor = Sensor(time, coil, rate_hz)
    with pytest.raises(kind, match=words):
        record_sweep(coil, sensor, SHORT)
    assert max(map(abs, coil.volts), default=0.0) <= most_v
    assert (coil.closed, sensor.closed) == (1, 1)


def test_what_cannot_be_played_is_bad_input(time, monkeypatch):
    coil = Coil(time)
    sensor = Sensor(time, coil)
    with pytest.raises(InputError, match="level_v is 5 V; the actuator may get 2 V at most"):
        record_sweep(coil, sensor, SweepSettings(level_v=5.0))
    with pytest.raises(InputError, match="cannot be given voltages"):
        record_sweep(sensor, coil, SHORT)
    with pytest.raises(InputError, match="largest_m_s2 is 0"):
        SweepSettings(largest_m_s2=0.0)
    closed = sensor.closed

    def fail():
        raise MmtError("it cannot be closed")

    monkeypatch.setattr(coil, "close", fail)
    with pytest.raises(MmtError, match="cannot be closed"):
        record_sweep(coil, sensor, SweepSettings(duration_s=2.0, level_v=0.1))
    assert sensor.closed == closed + 1


def test_voltages_are_cut_at_the_limit_and_played_as_they_are(started, connected):
    pytest.importorskip("pty", reason="there are no pseudo-terminals")
    board = started(EmulatedHaptuatorBoard())
    options = {"port": board.path, "full_scale_v": 3.0, "volts_per_m_s2": 1.0, "limit_v": 1.5}
    device = connected(load_device("haptuator-serial", options))
    for _ in range(60):
        device.write_volts([9.0, math.nan, 0.1])
        sweeping.time.sleep(0.003)
    played = board.played()
    assert max(map(abs, played)) <= round(32767 / 2) + 1
    assert max(played) > 8000
    assert device.largest_v == 1.5


EQUALISE = ("device", "equalise")


def test_one_command_equalises_the_emulated_handle(tmp_path, monkeypatch):
    pytest.importorskip("pty", reason="there are no pseudo-terminals")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    drivers = ["--actuator", "virtual-haptuator", "--accelerometer", "virtual-handle-adxl335"]
    serial, kept = ("--serial", "T1"), tmp_path / "sweep.npz"
    options = ["--keep", kept, "--duration", 2, "--level-v", 0.3]
    figures, _ = run_json(tmp_path, *EQUALISE, *drivers, *options, *serial)
    assert figures["coherence"] > 0.8
    assert figures["remaining_db"] < figures["unevenness_db"]
    assert Path(figures["file"]).is_relative_to(tmp_path)
    again, _ = run_json(tmp_path, *EQUALISE, kept, *serial)
    assert again["volts_per_m_s2"] == pytest.approx(figures["volts_per_m_s2"])
    device = load_device("virtual-haptuator", {"serial": "T1"})
    device.connect()
    device.close()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("", "give a recording, a scene, or the driver by --actuator"),
        ("--actuator virtual-haptuator", "by --accelerometer"),
        ("sweep.npz", "--serial is missing"),
        ("sweep.npz --serial a --level-v 1", "a recording was given"),
        ("--set port=1", "write actuator.KEY=VALUE or accelerometer.KEY=VALUE"),
        ("virtual-lab", "has no actuator; it has robot"),
        (
            "--actuator ati-net-ft --accelerometer virtual-adxl335 --serial a",
            "it cannot be the actuator; drivers for that are haptuator-serial",
        ),
    ],
)
def test_what_cannot_be_equalised_is_bad_input(arguments, sentence):
    assert sentence in refusal(*EQUALISE, *arguments.split())


def test_a_sweep_that_cannot_be_stored_is_not_played(tmp_path, monkeypatch):
    (tmp_path / "mmt-haptics").write_text("")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    drivers = ["--actuator", "unknown", "--accelerometer", "unknown", "--serial", "T1"]
    assert "haptuator-T1.json: Not a directory" in refusal(*EQUALISE, *drivers)
