"""Streaming from devices: what is read, what is missed, and what fails."""

import numpy as np
import pytest
from instruments import Instrument

from mmt.core.errors import InputError, MmtError
from mmt.core.frames import CHANNELS
from mmt.devices.drivers import load_device
from mmt.devices.streaming.source import DeviceSource


def made(**failures):
    devices = [Instrument(10.0), Instrument(20.0), Instrument(30.0, **failures)]
    return DeviceSource(*devices, CHANNELS), devices


def test_every_device_is_read_once_a_tick():
    source, devices = made()
    source.start(0)
    ticks = enumerate((1, 1, 4))  # two are missed, which shows as a gap
    frames = np.concatenate([source.step(elapsed, 1000 + k, None) for k, elapsed in ticks])
    assert frames["sequence"].tolist() == [0, 1, 5]
    assert frames["time_ns"].tolist() == [1000, 1001, 1002]
    assert frames["position_mm"][0].tolist() == [10.0, 11.0, 12.0]
    assert frames["force_n"][1].tolist() == [20.0, 21.0, 22.0]
    assert frames["acceleration_m_s2"][2].tolist() == [30.0, 31.0, 32.0]
    for device in devices:
        assert device.calls == ["connect", "calibrate", "read", "read", "read"]
    assert not source.finished
    assert source.annotations == b""
    assert source.describe() == (
        "devices: robot Instrument, force sensor Instrument, accelerometer Instrument"
    )


def test_ticks_begin_after_the_turn_of_a_device_that_has_turns():
    robot = Paced()
    source = DeviceSource(robot, Instrument(), Instrument(), CHANNELS)
    source.start(0)
    assert robot.calls == ["connect", "calibrate", "await_turn"]


def test_the_robot_is_commanded_before_it_is_read():
    robot, force_sensor = Instrument(), Instrument()
    source = DeviceSource(robot, force_sensor, None, ("position", "force"))
    assert source.step(1, 0, None).dtype.names == ("sequence", "time_ns", "position_mm", "force_n")
    source.step(1, 0, (1.0, 2.0, 3.0))
    assert robot.calls == ["read", "write", "read"]
    assert robot.written == [(1.0, 2.0, 3.0)]
    alone = DeviceSource(robot, force_sensor, None, ("force",))  # the scene's channels are read
    alone.step(1, 0, (0.0, 0.0, 0.0))
    assert robot.calls == ["read", "write", "read", "write"]
    force_sensor.read = lambda: (1.0, 2.0)  # of the wrong size
    with pytest.raises(MmtError, match=r"the force sensor \(Instrument\) failed"):
        alone.step(1, 0, None)


@pytest.mark.parametrize(
    ("channel", "key"), [("force", "force_sensor"), ("acceleration", "accelerometer")]
)
def test_a_channel_without_a_device_is_explained(channel, key):
    with pytest.raises(InputError, match=rf"\[devices\] has no {key}, .* needs {channel}"):
        DeviceSource(Instrument(), None, None, ("position", channel))


class Paced(Instrument):
    def await_turn(self):
        self._do("await_turn")


@pytest.mark.parametrize(
    ("call", "error", "reason"),
    [
        ("connect", OSError(5, "Input/output error"), "Input/output"),
        ("calibrate", ValueError(), "ValueError"),
        ("await_turn", OSError(19, "No such device"), "No such device"),
        ("read", OSError(19, "No such device"), "No such device"),
        ("read", ValueError(), "ValueError"),
        ("read", MmtError("cable 3 is loose"), "cable 3 is loose"),
    ],
)
def test_a_device_that_fails_is_named_whatever_its_driver_raises(call, error, reason):
    source = DeviceSource(Instrument(), Instrument(), Paced(**{call: error}), CHANNELS)

    def run():
        source.start(0)
        source.step(1, 0, None)

    with pytest.raises(MmtError, match=rf"the accelerometer \(Paced\) failed: .*{reason}"):
        run()


def test_all_are_closed_when_one_does_not_close():
    devices = [Instrument(close=OSError("stuck")), Instrument(), Instrument(close=OSError("gone"))]
    source = DeviceSource(*devices, CHANNELS)
    with pytest.raises(MmtError, match=r"robot .*stuck; the accelerometer .*gone"):
        source.close()
    assert [device.calls for device in devices] == [["close"]] * 3


@pytest.mark.parametrize(
    ("name", "kind", "sentence"),
    [
        ("lab_driverz:Robot", InputError, "module lab_driverz cannot be imported"),
        ("broken_drivers:Robot", InputError, r"cannot be imported \(libHD.so is missing\)"),
        ("lab_drivers:Robots", InputError, "has no factory 'Robots'"),
        ("lab_drivers:number", InputError, "has no factory 'number'"),
        ("lab_drivers:absent", MmtError, "'lab_drivers:absent' cannot be made: no such port"),
        ("lab_drivers:explained", MmtError, "^switch it on$"),
    ],
)
def test_a_device_that_cannot_be_had_is_explained(drivers, name, kind, sentence):
    assert load_device(f"{drivers}:Robot").read() == (0.0, 1.0, 2.0)
    with pytest.raises(kind, match=sentence) as caught:
        load_device(name)
    assert type(caught.value) is kind
