"""Sessions over devices: both services, slow and lost devices, the virtual lab."""

import asyncio
import threading
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from instruments import Instrument
from service_runs import LONGEST_S, Together, small_scene

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.protocols import SensorReading
from mmt.scene.files import load_scene
from mmt.session.files import read_session


def scene_of(tmp_path, drivers, **devices):
    """A scene of devices, of which some are of classes that are in this file."""
    (tmp_path / "own_drivers.py").write_text(
        "from test_device_sessions import Late, OwnClock, Slow"
    )
    named = dict.fromkeys(("robot", "force_sensor", "accelerometer"), f"{drivers}:Robot")
    table = {**named, "on_lost": "hold", **devices}
    return small_scene(tmp_path, devices=table, simulated=None)


class Slow(Instrument):
    """A device whose connection takes as long as the test wants."""

    asked: ClassVar[threading.Event]
    goes_on: ClassVar[threading.Event]
    made: ClassVar[list[Any]]

    def __init__(self):
        super().__init__()
        self.made.append(self)

    def connect(self):
        self.asked.set()
        assert self.goes_on.wait(20.0), "the loop that would let it go on stands still"


@pytest.fixture
def slow_scene(tmp_path, drivers):
    Slow.asked, Slow.goes_on, Slow.made = threading.Event(), threading.Event(), []
    return scene_of(tmp_path, drivers, robot="own_drivers:Slow")


async def test_the_leader_is_answered_while_devices_are_connected(slow_scene):
    together = await Together.listening(slow_scene)
    following = asyncio.create_task(together.follow())
    before = together.leader.ticker.statistics.ticks
    await together.until(lambda: together.leader.ticker.statistics.ticks > before + 300)
    assert together.leader.status().frames == 0
    Slow.goes_on.set()
    await together.until(lambda: together.leader.status().frames > 20)
    assert (await together.stop()).problem is None
    assert (await following).problem is None


async def test_a_session_that_ends_while_devices_are_connected_does_not_wait_and_closes_them(
    slow_scene,
):
    together = await Together.listening(slow_scene)
    following = asyncio.create_task(together.follow())
    await together.until(Slow.asked.is_set)
    assert (await together.stop()).problem is None
    assert (await following).problem is None
    (device,) = Slow.made
    assert device.calls == ["close"]
    Slow.goes_on.set()
    async with asyncio.timeout(LONGEST_S):
        while device.calls != ["close", "calibrate", "close"]:
            await asyncio.sleep(0.005)


class OwnClock:
    """A force sensor of 2 kHz on a clock of its own, that can be unplugged while it runs."""

    made: ClassVar[list[Any]] = []

    def __init__(self, force_n=1.0):
        self.latency_ns = 0
        self.faults = {}
        self.force_n = force_n
        self.unplugged = False
        self.made.append(self)

    def connect(self):
        if self.unplugged:
            raise MmtError("the cable is out")
        self._begun_ns = self._read_to_ns = time.monotonic_ns()

    def calibrate(self):
        pass

    def read(self):
        if self.unplugged:
            raise DeviceLost("the cable is out")
        now_ns = time.monotonic_ns()
        stamps = range(self._read_to_ns, now_ns, 500_000)
        self._read_to_ns = stamps[-1] + 500_000 if stamps else self._read_to_ns
        return [SensorReading(t - self._begun_ns, (0.0, 0.0, self.force_n)) for t in stamps]

    def close(self):
        pass


class Late(OwnClock):
    """A sensor that gives its first reading when the test wants."""

    begins: ClassVar[threading.Event]
    asked: ClassVar[threading.Event]

    def read(self):
        self.asked.set()
        return super().read() if self.begins.is_set() else []


@pytest.fixture
def late_scene(tmp_path, drivers):
    Late.begins, Late.asked = threading.Event(), threading.Event()
    return scene_of(tmp_path, drivers, force_sensor="own_drivers:Late")


async def test_the_clocks_are_exchanged_while_a_sensor_gives_no_reading_yet(late_scene):
    together = await Together.listening(late_scene)
    follower = together.follower()
    following = asyncio.create_task(follower.run())
    await together.until(Late.asked.is_set)
    await together.until(lambda: follower.client.clock.estimate is not None)
    assert follower.ticker.statistics.ticks == 0
    Late.begins.set()
    await together.until(lambda: together.leader.status().frames > 20)
    assert (await together.stop()).problem is None
    assert (await following).problem is None


async def test_a_session_that_is_stopped_before_a_sensors_first_reading_has_not_failed(late_scene):
    together = await Together.listening(late_scene)
    follower = together.follower()
    following = asyncio.create_task(follower.run())
    await together.until(Late.asked.is_set)
    follower.stop()
    assert (await following).outcome == "stopped"
    await together.stop()


async def test_a_session_survives_a_sensor_that_is_unplugged_and_plugged_again(tmp_path, drivers):
    OwnClock.made.clear()
    sensor = {"driver": "own_drivers:OwnClock", "force_n": 2.5}
    together = await Together.listening(scene_of(tmp_path, drivers, force_sensor=sensor))
    following = asyncio.create_task(together.follow())
    await together.until(lambda: together.leader.time_s > 0.3)
    (sensor,) = OwnClock.made
    sensor.unplugged = True
    await together.until(lambda: any("is lost: the cable is out: hold" in s for s in together.said))
    sensor.unplugged = False
    await together.until(lambda: any("force sensor (OwnClock) is back" in s for s in together.said))
    back_s = together.leader.time_s
    await together.until(lambda: together.leader.time_s > back_s + 0.3)
    assert (await together.stop()).problem is None
    summary = await following
    assert summary.problem is None
    assert summary.commands["halts"] == 1
    assert summary.devices["force_sensor"]["losses"] == 1
    frames = read_session(tmp_path / "session.mcap").frames
    assert (frames["force_n"] == (0.0, 0.0, 2.5)).all()
    assert np.diff(frames["sequence"].astype(np.int64)).max() >= 50
    assert (np.diff(frames["time_ns"]) > 0).all()


NEEDS_UR = pytest.mark.skipif(find_spec("rtde_control") is None, reason="ur-rtde is not installed")


@pytest.mark.parametrize("scene", ["virtual-lab", pytest.param("virtual-arm", marks=NEEDS_UR)])
async def test_emulated_devices_carry_the_main_job(tmp_path, scene):
    changes = {
        "link.port": 0,
        "recording.file": str(tmp_path / "session.mcap"),
        "session.duration_s": 100.0,  # on a busy machine frames are rare
        "devices.on_lost": "hold",  # and an emulated sensor may be held up
    }
    together = await Together.listening(load_scene(Path(scene), changes))
    following = asyncio.create_task(together.follow())
    await together.until(
        lambda: together.leader.time_s > 5.0 and together.leader.status().frames > 200
    )
    assert (await together.stop()).problem is None
    summary = await following
    assert summary.problem is None
    assert summary.devices["force_sensor"]["readings"] > 500
    assert summary.devices["accelerometer"]["readings"] > 500
    frames = read_session(tmp_path / "session.mcap").frames
    assert len(frames) > 200
    # gravity and a texture, whatever the few frames of a busy machine meet
    assert 8.0 < np.median(np.linalg.norm(frames["acceleration_m_s2"], axis=1)) < 16.0
    assert frames["force_n"][:, 2].max() > 0.1  # the hand has pressed on the surface
    assert np.ptp(frames["position_mm"][:, 2]) > 4.0
