"""The virtual lab: a world that moves by the clock, and drivers that find its devices."""

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from sensor_reading import read_some, read_until
from waiting import check_refused, until_lost

from mmt.core.errors import DeviceLost, InputError
from mmt.core.frames import empty_frames
from mmt.devices.drivers import load_device
from mmt.testing.emulated import drivers as drivers_module
from mmt.testing.emulated import lab as world_module
from mmt.testing.emulated.drivers import VirtualRobot
from mmt.testing.emulated.lab import TICK_NS, World


class Turns:
    """A clockwork, turned by hand."""

    turn: Callable[[int], int]

    def add(self, turn):
        self.turn = turn


def test_the_world_shakes_as_fast_as_its_frames_tell(monkeypatch):
    """Its acceleration passes through the samples of each frame, each at its time."""
    ticks = 100
    frames = empty_frames(ticks, samples_per_frame=4)
    times_ms = np.arange(1, 4 * ticks + 1) / 4
    frames["acceleration_m_s2"][:, :, 0] = np.sin(1.5 * times_ms).reshape(ticks, 4)
    frames["position_mm"][:, 0] = np.arange(1, ticks + 1)
    rows = iter(frames[np.newaxis].T)
    follower = SimpleNamespace(step=lambda *_: next(rows))
    monkeypatch.setattr(world_module, "SimulatedFollower", lambda *_, **__: follower)
    monkeypatch.setattr("time.monotonic_ns", lambda: 0)
    world = World("wood", 3, turns := Turns(), samples_per_frame=4)
    world.start()
    turns.turn(ticks * TICK_NS)
    for place_ms in (70.0, 70.1, 70.25, 71.9, 80.0):
        time_ns = round((place_ms + 4) * TICK_NS)  # it is shown four ticks late
        x, _, _ = world.acceleration_m_s2(time_ns)
        assert x == pytest.approx(math.sin(1.5 * place_ms), abs=2e-3)
        assert world.position_mm(time_ns)[0] == pytest.approx(place_ms)


def test_the_labs_accelerometer_measures_at_twice_the_rate_of_its_world(connected):
    options = {"surface": "wood", "acceleration_rate_hz": 3000}
    connected(load_device("virtual-robot", options))
    sensor = load_device("virtual-adxl335", {**options, "band_hz": 1500}, role="accelerometer")
    readings = read_some(connected(sensor), 600)
    steps_ns = np.diff([reading.time_ns for reading in readings])
    assert np.median(steps_ns) == pytest.approx(1e9 / 6000, abs=2000)
    felt = np.mean([reading.value for reading in readings], axis=0)
    assert math.hypot(*felt) == pytest.approx(9.81, abs=0.3)


@pytest.mark.parametrize(
    ("force_sensor", "accelerometer"),
    [
        (("virtual-net-ft", {"rate_hz": 1000}), ("virtual-adxl335", {})),
        (
            ("virtual-bota", {"sinc_length": 64}),
            ("virtual-iio", {"rate_hz": 1000, "latency_ms": 1}),
        ),
    ],
)
def test_the_devices_share_a_lab_which_ends_with_the_last_of_them(force_sensor, accelerometer):
    robot = load_device("virtual-robot", {"surface": "wood"})
    force, shaken = load_device(*force_sensor), load_device(*accelerometer)
    devices = (robot, force, shaken)
    for device in devices:
        check_refused(device.read, "not connected", DeviceLost)
    try:
        for device in devices:
            device.connect()
            device.calibrate()
        process = drivers_module.LAB.process
        assert process is not None
        assert robot.read() == pytest.approx((0.0, 0.0, 5.0), abs=0.01)
        robot.write((0.0, 0.0, -2.0))
        pressed = read_until(force, lambda come: come and come[-1].value[2] > 1.0)
        assert pressed[0].value[2] < 1.0

        def resting(come):  # the tip has struck the surface, and rings first
            felt = [math.hypot(*reading.value) for reading in come[-50:]]
            return len(felt) == 50 and np.median(felt) == pytest.approx(9.8, abs=1.0)

        read_until(shaken, resting)
        assert robot.read()[2] < 1.0
        assert force.latency_ns >= 0
        assert shaken.latency_ns > 0
        robot.close()
        force.close()
        assert process.poll() is None
    finally:
        for device in devices:
            device.close()
    assert process.poll() == 0
    assert drivers_module.LAB.process is None


def test_a_lab_that_dies_is_a_lost_robot_and_comes_back(connected):
    check_refused(VirtualRobot(surface="velcro").connect, r"does not start: .*velcro")
    robot = connected(VirtualRobot())
    process = drivers_module.LAB.process
    process.kill()
    process.wait(60.0)
    until_lost(lambda: (robot.read(), robot.write((0.0, 0.0, 5.0))), "its lab has ended|is gone")
    robot.connect()
    assert robot.read() == pytest.approx((0.0, 0.0, 5.0), abs=0.01)


def test_a_wrong_option_is_told_before_the_lab_starts():
    for name, driver in {
        "virtual-net-ft": "ati-net-ft",
        "virtual-bota": "bota-serial",
        "virtual-handle-adxl335": "adxl335-serial",
        "virtual-iio": "iio-accelerometer",
        "virtual-haptuator": "haptuator-serial",
        "virtual-inverse3": "inverse3",
    }.items():
        words = f"^{name}: device '{driver}': foo is not a key; allowed are "
        with pytest.raises(InputError, match=words):
            load_device(name, {"foo": 1, "seed": 3})
        level = {"volts_per_m_s2": 0.1} if driver == "haptuator-serial" else {}
        load_device(name, {"seed": 3, **level}).close()
