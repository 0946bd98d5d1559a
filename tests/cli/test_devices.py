"""`mmt device`: what there is, what it measures, and what is wrong with it."""

import json
import re
import time
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner, Result

from mmt.cli.main import app
from mmt.devices import discovery, table
from mmt.devices.observing import observe
from mmt.errors import InputError, MmtError

DRIVERS = '''
"""Devices for tests."""
import math
import time

from mmt.devices.protocols import InterfaceState, SensorReading
from mmt.devices.voltages import VoltageReading
from mmt.errors import DeviceLost, MmtError


class Polled:
    def __init__(self, z=9.81, absent=False):
        self.z, self.absent, self.closed = z, absent, 0

    def connect(self):
        if self.absent:
            raise MmtError("the box does not answer at 192.168.1.1: is it switched on?")

    def calibrate(self):
        self.z = 0.0

    def read(self):
        return (0.0, 0.0, self.z)

    def write(self, position_mm):
        raise AssertionError("it must not be moved")

    def close(self):
        self.closed += 1


class Sampled(Polled):
    latency_ns = 200_000

    def __init__(self, rate_hz=2000, noise=1.0, silent=False, at_once=1, lost_after=None, **faults):
        super().__init__()
        self.rate_hz, self.noise, self.silent, self.at_once = rate_hz, noise, silent, at_once
        self.lost_after, self.faults = lost_after, faults
        self.given = 0

    def connect(self):
        self.begun_ns = time.monotonic_ns()

    def read(self):
        due = int((time.monotonic_ns() - self.begun_ns) * self.rate_hz / 1e9)
        if self.lost_after is not None and due > self.lost_after:
            raise DeviceLost("unplugged")
        if self.silent:
            return []
        due -= due % self.at_once
        come = [
            SensorReading(round(k * 1e9 / self.rate_hz), (0.0, self.noise * math.sin(k), 9.81))
            for k in range(self.given, due)
        ]
        self.given = max(due, self.given)
        return come


class Handle(Polled):
    def read(self, elapsed_ticks):
        return InterfaceState((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.0, False)


class Board(Polled):
    latency_ns = 0
    faults = {}

    def read(self):
        return [VoltageReading(time.monotonic_ns(), (0.1, 0.2, 0.3, 0.4))]


class Bare:
    pass


class Sensor:
    def connect(self):
        pass

    def read(self):
        return (0.0, 0.0, 9.81)

    def close(self):
        pass


def made_sensor() -> Sensor:
    return Sensor()


class Actuator:
    def write(self, samples):
        assert not any(samples)

    def connect(self):
        pass

    def calibrate(self):
        pass

    def close(self):
        pass
'''


@pytest.fixture
def drivers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    name = f"cli_drivers_{tmp_path.name}".replace("-", "_")
    (tmp_path / f"{name}.py").write_text(DRIVERS)
    monkeypatch.syspath_prepend(str(tmp_path))
    return name


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["device", *map(str, arguments)])


def figures_of(drivers: str, name: str, directory: Path, *settings: str) -> tuple[Result, dict]:
    given = [word for setting in settings for word in ("--set", setting)]
    file = directory / "test.json"
    result = run("test", f"{drivers}:{name}", *given, "--duration", 0.3, "--json", file)
    return result, json.loads(file.read_text())["devices"][0]


BUSY = "this machine is busy"


def of_the_device(problems: list[str]) -> list[str]:
    """What is wrong, but for this machine's own load."""
    return [problem for problem in problems if BUSY not in problem]


def test_a_sensor_that_works_shows_its_values_and_rate(drivers: str, tmp_path: Path) -> None:
    result, seen = figures_of(drivers, "Sampled", tmp_path)
    assert result.exit_code == bool(seen["problems"]), result.output
    assert seen["rate_hz"] == pytest.approx(2000, rel=0.2)
    assert seen["spacing_p50_ms"] == pytest.approx(0.5)
    assert seen["mean"][2] == pytest.approx(9.81)
    assert seen["most"][1] == pytest.approx(1.0, abs=0.01)
    assert of_the_device(seen["problems"]) == []


def test_a_polled_device_is_read_and_never_commanded(drivers: str, tmp_path: Path) -> None:
    result, seen = figures_of(drivers, "Polled", tmp_path, "z=2.5")
    assert result.exit_code == 0, result.output
    assert seen["mean"] == [0.0, 0.0, 2.5]
    assert seen["rate_hz"] is None


@pytest.mark.parametrize(
    ("name", "settings", "sentence"),
    [
        ("Polled", ["absent=true"], "is it switched on?"),
        ("Sampled", ["lost_after=50"], "unplugged"),
        ("Sampled", ["rate_hz=134"], "raise its rate or its baud rate"),
        ("Sampled", ["checksum=3"], "3 times: checksum"),
        ("Polled", ["z=nan"], "no numbers"),
    ],
)
def test_what_is_wrong_is_said_with_what_to_do(
    drivers: str, tmp_path: Path, name: str, settings: list[str], sentence: str
) -> None:
    result, seen = figures_of(drivers, name, tmp_path, *settings)
    assert result.exit_code == 1
    assert any(sentence in problem for problem in seen["problems"]), seen["problems"]
    assert sentence.split(maxsplit=1)[0] in result.output


def test_a_silent_and_a_stuck_sensor_are_told_apart(drivers: str) -> None:
    module = __import__(drivers)
    silent = observe("force_sensor", "a", module.Sampled(silent=True), duration_s=2.0)
    assert "gives no reading: check its cable" in silent.problems[0]
    stuck = module.Sampled(noise=0.0)
    assert "never changes" in observe("force_sensor", "a", stuck, duration_s=1.2).problems[0]
    assert stuck.closed == 1


@pytest.mark.parametrize(("z", "words"), [(1.0, "may be in g"), (3.0, "feels 3: keep it still")])
def test_an_accelerometer_must_feel_gravity(drivers: str, z: float, words: str) -> None:
    device = __import__(drivers).Polled(z=z)
    assert words in observe("accelerometer", "a", device, duration_s=0.05).problems[0]


def test_calibration_is_asked_for(drivers: str, tmp_path: Path) -> None:
    file = tmp_path / "c.json"
    run("test", f"{drivers}:Polled", "--duration", 0.1, "--calibrate", "--json", file)
    assert json.loads(file.read_text())["devices"][0]["mean"] == [0.0, 0.0, 0.0]


def test_all_devices_of_a_scene_are_tested(drivers: str, tmp_path: Path) -> None:
    scene = tmp_path / "lab.toml"
    scene.write_text(
        f'[link]\n[devices]\nrobot = "{drivers}:Polled"\naccelerometer = "{drivers}:Sampled"\n'
        f'[handle]\ndriver = "{drivers}:Handle"\n[playout]\n'
        f'[actuator]\ndriver = "{drivers}:Actuator"\n'
    )
    result = run("test", scene, "--duration", 0.1, "--json", tmp_path / "s.json")
    seen = json.loads((tmp_path / "s.json").read_text())["devices"]
    problems = [problem for one in seen for problem in one["problems"]]
    assert of_the_device(problems) == []
    assert result.exit_code == bool(problems), result.output
    assert [one["role"] for one in seen] == ["robot", "accelerometer", "handle", "actuator"]
    assert seen[2]["mean"] == [1.0, 2.0, 3.0]
    assert seen[3]["readings"] == 0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["nothing"], "driver 'nothing' is not known"),
        (["a:B", "--set", "x"], "write KEY=VALUE"),
        (["demo"], "names no device"),
        (["demo", "--set", "x=1"], "a scene has its own"),
    ],
)
def test_what_cannot_be_tested_is_bad_input(arguments: list[str], sentence: str) -> None:
    result = run("test", *arguments)
    assert isinstance(result.exception, InputError)
    assert sentence in str(result.exception)


def test_the_list_has_drivers_ports_and_what_is_missing(
    drivers: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import serial.tools.list_ports as ports
    import usb.core

    monkeypatch.setitem(table.DRIVERS, "good", {"robot": f"{drivers}:Polled"})
    monkeypatch.setitem(table.DRIVERS, "bad", {"robot": "nowhere.at_all:Polled"})
    port = SimpleNamespace(
        device="/dev/none", vid=0x16C0, pid=0x0483, product="Teensy", description="", hwid="USB"
    )
    port.serial_number = "42"
    monkeypatch.setattr(ports, "comports", lambda: [port])
    labjack = SimpleNamespace(idVendor=0x0CD5, idProduct=6, bus=1, address=4)
    other = SimpleNamespace(idVendor=1, idProduct=2, bus=1, address=5)
    monkeypatch.setattr(usb.core, "find", lambda find_all: [labjack, other])
    result = run("list", "--json", tmp_path / "l.json")
    assert result.exit_code == 0
    found = json.loads((tmp_path / "l.json").read_text())
    states = {driver["name"]: driver["problem"] for driver in found["drivers"]}
    assert states["good"] == ""
    assert "cannot be imported" in states["bad"]
    assert found["serial_ports"][0]["what"] == "Teensy (16c0:0483)"
    assert [device["what"] for device in found["usb_devices"]] == ["LabJack U6"]


def test_without_libusb_the_list_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import usb.core

    def find(find_all: bool) -> None:
        raise usb.core.NoBackendError("none")

    monkeypatch.setattr(usb.core, "find", find)
    with pytest.raises(MmtError, match=r"libusb 1\.0 is not there: install it"):
        discovery.find_usb_devices()


def test_a_port_without_permission_is_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ttyACM0").write_text("")
    monkeypatch.setattr(discovery.os, "access", lambda path, mode: False)
    assert "usermod -a -G" in discovery._access_problem(str(tmp_path / "ttyACM0"))
    assert discovery._access_problem(str(tmp_path / "ttyACM1")) == ""


def test_a_usb_device_without_permission_gets_its_udev_rule(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(discovery.os, "access", lambda path, mode: False)
    sentence = discovery._access_problem(str(tmp_path), 0x0CD5)
    assert 'ATTR{idVendor}=="0cd5"' in sentence
    assert "/etc/udev/rules.d" in sentence


def test_a_library_that_is_missing_is_named_with_the_drivers_that_want_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none() -> None:
        raise MmtError("the sound card needs PortAudio")

    monkeypatch.setattr("mmt.devices.haptuator.library.load_sounddevice", none)
    monkeypatch.setattr(discovery, "find_library", lambda name: None)
    result = run("list", "--json", tmp_path / "l.json")
    assert result.exit_code == 0
    problems = json.loads((tmp_path / "l.json").read_text())["problems"]
    assert "haptuator-sound, sound outputs: the sound card needs PortAudio" in problems
    assert any(text.startswith("openhaptics: the vendor's library") for text in problems)


def test_the_list_shows_each_role_that_a_driver_can_take(
    drivers: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = {"lab-arm": "Polled", "lab-handle": "Handle", "lab-coil": "Actuator", "lab-?": "Bare"}
    names |= {"lab-line": "made_sensor"}
    entries = [EntryPoint(name, f"{drivers}:{made}", table.GROUP) for name, made in names.items()]
    monkeypatch.setattr(table, "entry_points", lambda group: entries)
    assert run("list", "--json", tmp_path / "l.json").exit_code == 0
    found = json.loads((tmp_path / "l.json").read_text())["drivers"]
    roles = {driver["name"]: driver["roles"] for driver in found}
    assert roles["openhaptics"] == ["robot", "handle"]
    assert roles["labjack-u6"] == ["board"]
    assert roles["lab-arm"] == ["robot"]
    assert roles["lab-handle"] == ["handle"]
    assert roles["lab-coil"] == ["actuator"]
    assert roles["lab-line"] == ["force_sensor", "accelerometer"]
    assert roles["lab-?"] == []


def test_a_driver_is_tested_in_the_role_that_is_asked_for(drivers: str, tmp_path: Path) -> None:
    file = tmp_path / "r.json"
    arguments = ["--role", "accelerometer", "--duration", 0.1, "--json", file]
    run("test", f"{drivers}:made_sensor", *arguments)
    seen = json.loads(file.read_text())["devices"][0]
    assert seen["role"] == "accelerometer"


@pytest.mark.parametrize(
    ("what", "role", "sentence"),
    [
        ("ati-net-ft", "handle", "cannot be that; allowed are force_sensor"),
        ("virtual-lab", "handle", "has no handle; it has robot, force_sensor, accelerometer"),
    ],
)
def test_a_role_that_a_driver_cannot_take_is_bad_input(what: str, role: str, sentence: str) -> None:
    result = run("test", what, "--role", role)
    assert isinstance(result.exception, InputError)
    assert sentence in str(result.exception)


def test_an_actuator_plays_silence_and_shows_what_it_counted(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    options = ["--set", "full_scale_v=3", "--set", "volts_per_m_s2=0.1", "--set", "buffer_ms=100"]
    driver = "mmt.devices.emulated.haptuator:emulated_haptuator"
    run("test", driver, *options, "--duration", 0.4, "--json", file)
    seen = json.loads(file.read_text())["devices"][0]
    assert seen["role"] == "actuator"
    assert seen["played"]["samples"] >= 100
    assert seen["played"]["peak_m_s2"] == 0.0


def test_a_board_shows_the_voltages_of_its_inputs(drivers: str) -> None:
    seen = observe("board", "a", __import__(drivers).Board(), duration_s=0.05)
    assert seen.mean == pytest.approx((0.1, 0.2, 0.3, 0.4))
    assert seen.unit == "V"


def test_a_capacitor_that_passes_too_little_is_a_problem(drivers: str) -> None:
    from mmt.devices.loading import load_device

    sensor = load_device("adxl335-serial", {"port": "/dev/none", "bandwidth_hz": 50})
    problems = observe("accelerometer", "adxl335-serial", sensor, duration_s=0.05).problems
    assert any("Replace the three capacitors by 0.01 uF or less" in text for text in problems)


def test_readings_that_come_in_bursts_are_told(drivers: str) -> None:
    sensor = __import__(drivers).Sampled(at_once=80)
    (problem,) = observe("force_sensor", "a", sensor, duration_s=0.5).problems
    assert "come in bursts, up to" in problem or BUSY in problem


def test_a_busy_machine_is_told_from_a_fault(drivers: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sensor = __import__(drivers).Sampled()
    sleep = time.sleep
    monkeypatch.setattr("mmt.devices.observing.time.sleep", lambda _: sleep(0.03))
    problems = observe("force_sensor", "a", sensor, duration_s=0.5).problems
    assert len(problems) == 1
    assert "this machine is busy, the test itself had to wait up to" in problems[0]


def test_the_documented_driver_is_found_as_a_package_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (Path(__file__).parents[2] / "docs/how-to/devices.md").read_text(encoding="utf-8")
    driver = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    project = re.search(r"```toml\n(\[project\].*?)```", text, re.DOTALL)
    assert driver is not None
    assert project is not None
    assert sum(bool(line.strip()) for line in driver[1].splitlines()) <= 30
    entries = tomllib.loads(project[1])["project"]["entry-points"][table.GROUP]
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "sensors.py").write_text(driver[1])
    information = tmp_path / "lab_devices-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: lab-devices\nVersion: 1.0\n"
    )
    lines = [f"[{table.GROUP}]", *(f"{name} = {value}" for name, value in entries.items())]
    (information / "entry_points.txt").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(str(tmp_path))
    run("list", "--json", tmp_path / "l.json")
    found = json.loads((tmp_path / "l.json").read_text())["drivers"]
    (line,) = [each for each in found if each["name"] == "lab-line"]
    assert line["package"] == "lab-devices"
    assert line["problem"] == ""
    assert line["roles"] == ["force_sensor", "accelerometer"]
    result = run("test", "lab-line", "--role", "accelerometer", "--set", "port=/dev/none")
    assert result.exit_code == 1
    assert "line sensor at /dev/none" in result.output
    missing = run("test", "lab-line")
    assert isinstance(missing.exception, InputError)
    assert "'port'; its options are port, baud=1000000" in str(missing.exception)
