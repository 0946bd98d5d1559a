"""`mmt device list`: what there is, and what is missing."""

from types import SimpleNamespace

import pytest
from command_runs import run_json
from plugin_samples import install_package

from mmt.core.errors import MmtError
from mmt.devices import discovery
from mmt.devices import drivers as driver_table


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
