"""`mmt device`: what there is, what it measures, and what is wrong with it."""

import re
import time
import tomllib
from pathlib import Path
from types import SimpleNamespace

import device_drivers
import pytest
from command_runs import refusal, run, run_json
from plugin_samples import install_package

from mmt.core.errors import MmtError
from mmt.devices import discovery
from mmt.devices import drivers as driver_table
from mmt.devices.device_check import check_device
from mmt.devices.discovery import lacking
from mmt.devices.drivers import load_device


def tried(directory, what, *options):
    """Test devices; return their figures as well."""
    figures, result = run_json(directory, "device", "test", what, *options, code=None)
    return result, figures["devices"]


def figures_of(name, directory, *settings):
    given = [word for setting in settings for word in ("--set", setting)]
    result, (seen,) = tried(directory, f"device_drivers:{name}", *given, "--duration", 0.3)
    return result, seen


BUSY = "this machine is busy"


def of_the_device(problems):
    """What is wrong, but for this machine's own load."""
    return [problem for problem in problems if BUSY not in problem]


def test_a_sensor_that_works_shows_its_values_and_rate(tmp_path):
    result, seen = figures_of("Sampled", tmp_path)
    assert result.exit_code == bool(seen["problems"]), result.output
    assert seen["rate_hz"] == pytest.approx(2000, rel=0.2)
    assert seen["spacing_p50_ms"] == pytest.approx(0.5)
    assert seen["mean"][2] == pytest.approx(9.81)
    assert seen["most"][1] == pytest.approx(1.0, abs=0.01)
    assert of_the_device(seen["problems"]) == []


def test_a_polled_device_is_read_in_the_role_that_is_asked_for_and_calibrated(tmp_path):
    result, seen = figures_of("Polled", tmp_path, "z=2.5")
    assert result.exit_code == 0, result.output
    assert (seen["mean"], seen["rate_hz"]) == ([0.0, 0.0, 2.5], None)
    _, (seen,) = tried(tmp_path, "device_drivers:Polled", "--duration", 0.1, "--calibrate")
    assert seen["mean"] == [0.0, 0.0, 0.0]
    options = ("--role", "accelerometer", "--duration", 0.1)
    _, (seen,) = tried(tmp_path, "device_drivers:made_sensor", *options)
    assert seen["role"] == "accelerometer"


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
def test_what_is_wrong_is_said_with_what_to_do(tmp_path, name, settings, sentence):
    result, seen = figures_of(name, tmp_path, *settings)
    assert result.exit_code == 1
    assert any(sentence in problem for problem in seen["problems"]), seen["problems"]
    assert sentence.split(maxsplit=1)[0] in result.output


def test_a_silent_a_stuck_and_a_bursting_sensor_are_told_apart():
    silent = check_device("force_sensor", "a", device_drivers.Sampled(silent=True), duration_s=9.0)
    assert "gives no reading: check its cable" in silent.problems[0]
    stuck = device_drivers.Sampled(noise=0.0)
    # longer than the second that it takes, so that a pause of this machine spoils nothing
    seen = check_device("force_sensor", "a", stuck, duration_s=2.5)
    assert "never changes" in " ".join(seen.problems)
    assert stuck.closed == 1
    bursts = device_drivers.Sampled(at_once=80)
    (problem,) = check_device("force_sensor", "a", bursts, duration_s=0.5).problems
    assert "come in bursts, up to" in problem or BUSY in problem


@pytest.mark.parametrize("value", [(0.0, 9.8), "abc", None, ("0", "0", "9.8"), (1j, 0, 0)])
def test_a_reading_that_no_session_takes_is_shown(value):
    device = device_drivers.Polled()
    device.read = lambda: value
    (problem,) = check_device("accelerometer", "a", device, duration_s=0.05).problems
    assert problem.startswith(f"its read() gives {value!r}: a reading is three numbers")


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 2.0, -1.0])
def test_stamps_in_another_unit_are_told_of(unit):
    class Odd(device_drivers.Sampled):
        def read(self):
            return [(unit * time_ns, value) for time_ns, value in super().read() or ()]

    problems = " ".join(check_device("force_sensor", "a", Odd(), duration_s=0.8).problems)
    assert "time_ns in nanoseconds" in problems


def test_a_driver_that_raises_when_it_is_asked_about_itself_is_told_and_closed():
    class Odd(device_drivers.Handle):
        def remarks(self):
            raise OSError("port closed")

        faults = property(remarks)

    problems = " ".join(check_device("handle", "a", handle := Odd(), duration_s=0.05).problems)
    assert re.search(r"checked to the end: port closed .*cannot be read \(port closed\)", problems)
    assert handle.closed == 1


def test_an_accelerometer_must_feel_gravity_and_pass_its_band():
    narrow = load_device("adxl335-serial", {"port": "/dev/none", "bandwidth_hz": 50})
    for device, words in (
        (device_drivers.Polled(z=1.0), "may be in g"),
        (device_drivers.Polled(z=3.0), "feels 3: keep it still"),
        (narrow, "Replace the three capacitors by 0.01 uF or less"),
    ):
        problems = check_device("accelerometer", "a", device, duration_s=0.05).problems
        assert words in " ".join(problems)


def test_a_board_shows_the_voltages_of_its_inputs():
    seen = check_device("board", "a", device_drivers.Board(), duration_s=0.05)
    assert (seen.mean, seen.unit) == (pytest.approx((0.1, 0.2, 0.3, 0.4)), "V")


def test_all_devices_of_a_scene_are_tested(tmp_path):
    scene = tmp_path / "lab.toml"
    scene.write_text(
        '[link]\n[devices]\nrobot = "device_drivers:Polled"\n'
        'accelerometer = "device_drivers:Sampled"\n[handle]\ndriver = "device_drivers:Handle"\n'
        '[playout]\n[actuator]\ndriver = "device_drivers:Actuator"\n'
    )
    result, seen = tried(tmp_path, scene, "--duration", 0.1)
    problems = [problem for one in seen for problem in one["problems"]]
    assert of_the_device(problems) == []
    assert result.exit_code == bool(problems), result.output
    assert [one["role"] for one in seen] == ["robot", "accelerometer", "handle", "actuator"]
    assert seen[2]["mean"] == [1.0, 2.0, 3.0]
    assert seen[3]["readings"] == 0


@pytest.mark.parametrize(
    ("accelerometer", "rate_hz", "said"),
    [("Sampled", 2000, 1000), ("Polled", 1000, 500), ("Sampled", 20_000, None)],
)
def test_an_accelerometer_must_give_what_a_frame_takes(tmp_path, accelerometer, rate_hz, said):
    options = f"rate_hz = {rate_hz}\n" if accelerometer == "Sampled" else ""
    scene = tmp_path / "lab.toml"
    scene.write_text(
        "[session]\nacceleration_rate_hz = 5000\n[link]\n[playout]\n[actuator]\n"
        '[devices]\nrobot = "device_drivers:Polled"\n'
        f'[devices.accelerometer]\ndriver = "device_drivers:{accelerometer}"\n{options}'
    )
    _, (seen,) = tried(tmp_path, scene, "--role", "accelerometer", "--duration", 0.3)
    assert seen["samples_hz"] == 5000
    told = [problem for problem in seen["problems"] if "acceleration_rate_hz" in problem]
    assert len(told) == (said is not None)
    if said is not None:
        above_hz = re.search(r"the scene takes 5000: nothing above (\d+) Hz", told[0])
        assert above_hz
        assert float(above_hz[1]) == pytest.approx(said, rel=0.1)


def test_an_actuator_plays_silence_and_shows_what_it_counted(tmp_path):
    options = ["--set", "full_scale_v=3", "--set", "volts_per_m_s2=0.1", "--set", "buffer_ms=100"]
    driver = "mmt.testing.emulated.haptuator:EmulatedHaptuator"
    _, (seen,) = tried(tmp_path, driver, *options, "--duration", 0.4)
    assert seen["role"] == "actuator"
    assert seen["played"]["samples"] >= 100
    assert seen["played"]["peak_m_s2"] == 0.0


def test_a_busy_machine_is_told_from_a_fault(monkeypatch):
    sensor = device_drivers.Sampled()
    sleep = time.sleep
    monkeypatch.setattr("mmt.devices.device_check.time.sleep", lambda _: sleep(0.03))
    problems = check_device("force_sensor", "a", sensor, duration_s=0.5).problems
    assert len(problems) == 1
    assert "this machine is busy, the test itself had to wait up to" in problems[0]


def test_the_documented_driver_is_found_as_a_package_of_its_own(tmp_path, monkeypatch):
    text = (Path(__file__).parents[2] / "docs/how-to/devices.md").read_text(encoding="utf-8")
    driver = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    project = re.search(r"```toml\n(\[project\].*?)```", text, re.DOTALL)
    assert sum(bool(line.strip()) for line in driver[1].splitlines()) <= 30
    entries = tomllib.loads(project[1])["project"]["entry-points"][driver_table.GROUP]
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "sensors.py").write_text(driver[1])
    install_package(tmp_path, monkeypatch, "lab-devices", {driver_table.GROUP: entries})
    found, _ = run_json(tmp_path, "device", "list")
    (line,) = [each for each in found["drivers"] if each["name"] == "lab-line"]
    assert line["package"] == "lab-devices"
    assert line["problem"] == ""
    assert line["roles"] == ["accelerometer"]
    line_sensor = ("device", "test", "lab-line")
    result = run(*line_sensor, "--set", "port=/dev/none")
    assert result.exit_code == 1
    assert "line sensor at /dev/none" in result.output
    assert "'port'; its options are port, baud=1000000" in refusal(*line_sensor)


def test_a_class_without_the_calls_of_a_device_is_not_good():
    result = run("device", "test", "device_drivers:Useless", "--duration", "0.1")
    assert result.exit_code == 1
    assert "good" not in result.output
    assert "has neither read() nor write()" in result.output
    assert "--role" in result.output


def test_a_drivers_own_mistake_is_told_with_its_line(tmp_path, monkeypatch):
    lines = ["class Odd:", "    def read(self):", "        return self.gone", "    connect = read"]
    (tmp_path / "odd_lab.py").write_text(
        "\n".join([*lines, "    def close(self):", "        int('x')"])
    )
    (tmp_path / "odder_lab.py").write_text("import math\n\nmath.pie")
    monkeypatch.syspath_prepend(str(tmp_path))
    said = "".join(run("device", "test", "odd_lab:Odd", "--role", "force_sensor").output.split())
    assert "AttributeError:'Odd'objecthasnoattribute'gone'(" in said  # lines end anywhere
    assert "odd_lab.py,line3)" in said
    assert "odd_lab.py,line6)" in said
    problem = str(run("device", "test", "odder_lab:Odd").exception)
    assert "odder_lab.py, line 3)" in problem
    assert "install the package" not in problem


def test_the_list_has_drivers_ports_and_what_is_missing(tmp_path, monkeypatch):
    import serial.tools.list_ports as ports
    import usb.core

    names = {"good.robot": "device_drivers:Polled", "bad.robot": "nowhere.at_all:Polled"}
    install_package(tmp_path, monkeypatch, "lab-devices", {driver_table.GROUP: names})
    port = SimpleNamespace(
        device="/dev/none", vid=0x16C0, pid=0x0483, product="Teensy", description="", hwid="USB"
    )
    port.serial_number = "42"
    monkeypatch.setattr(ports, "comports", lambda: [port])
    labjack = SimpleNamespace(idVendor=0x0CD5, idProduct=6, bus=1, address=4)
    other = SimpleNamespace(idVendor=1, idProduct=2, bus=1, address=5)
    monkeypatch.setattr(usb.core, "find", lambda find_all: [labjack, other])
    found, result = run_json(tmp_path, "device", "list")
    listed = {driver["name"]: driver for driver in found["drivers"]}
    assert (listed["good"]["problem"], listed["good"]["rates"]) == ("", "")
    assert listed["labjack-u6"]["rates"].startswith("100 to 50000 samples a second")
    assert "labjack-u6: 100 to 50000 samples a second" in " ".join(result.output.split())
    assert "cannot be imported" in listed["bad"]["problem"]
    assert found["serial_ports"][0]["what"] == "Teensy (16c0:0483)"
    assert [device["what"] for device in found["usb_devices"]] == ["LabJack U6"]


def test_without_libusb_the_list_says_what_to_install(monkeypatch):
    import usb.core

    def find(find_all):
        raise usb.core.NoBackendError("none")

    monkeypatch.setattr(usb.core, "find", find)
    with pytest.raises(MmtError, match=r"libusb 1\.0 is not there: install it"):
        discovery.find_usb_devices()


def test_a_port_or_usb_device_without_permission_is_explained(tmp_path, monkeypatch):
    (tmp_path / "ttyACM0").write_text("")
    monkeypatch.setattr(discovery.os, "access", lambda path, mode: False)
    assert "usermod -a -G" in discovery.access_problem(str(tmp_path / "ttyACM0"))
    assert discovery.access_problem(str(tmp_path / "ttyACM1")) == ""
    sentence = discovery.access_problem(str(tmp_path), 0x0CD5)
    assert 'ATTR{idVendor}=="0cd5"' in sentence
    assert "/etc/udev/rules.d" in sentence


def test_a_library_that_is_missing_is_named_with_the_drivers_that_want_it(tmp_path, monkeypatch):
    def none():
        raise MmtError("the sound card needs PortAudio")

    monkeypatch.setattr("mmt.devices.haptuator.sound.load_sounddevice", none)
    monkeypatch.setattr("mmt.devices.haptuator.sound.missing", lacking(none))
    monkeypatch.setattr("mmt.devices.openhaptics.robot.find_library", lambda name: None)
    problems = run_json(tmp_path, "device", "list")[0]["problems"]
    assert "haptuator-sound, sound outputs: the sound card needs PortAudio" in problems
    assert any(text.startswith("openhaptics: the vendor's library") for text in problems)


def test_the_list_shows_each_role_that_a_driver_can_take(tmp_path, monkeypatch):
    names = {"lab-arm": "Polled", "lab-handle": "Handle", "lab-coil": "Actuator", "lab-?": "Bare"}
    names |= {"lab-line": "made_sensor"}
    targets = {name: f"device_drivers:{made}" for name, made in names.items()}
    install_package(tmp_path, monkeypatch, "lab-devices", {driver_table.GROUP: targets})
    found, _ = run_json(tmp_path, "device", "list")
    roles = {driver["name"]: driver["roles"] for driver in found["drivers"]}
    assert {
        "openhaptics": ["robot", "handle"],
        "labjack-u6": ["board"],
        "lab-arm": ["robot"],
        "lab-handle": ["handle"],
        "lab-coil": ["actuator"],
        "lab-line": ["force_sensor", "accelerometer"],
        "lab-?": [],
    }.items() <= roles.items()
