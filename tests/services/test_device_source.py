"""Streaming from devices: what is read, what is missed, and what fails."""

import asyncio
import threading
import time
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from service_runs import Together, small_scene

from mmt.arrays import RecordArray
from mmt.devices.loading import load_device
from mmt.devices.protocols import DeviceBackedSource, FrameTaker, SensorReading, Vector
from mmt.devices.source import DeviceSource
from mmt.errors import DeviceLost, InputError, MmtError
from mmt.follower.driving import DrivenSource
from mmt.follower.sources import build_source
from mmt.frames import CHANNELS
from mmt.scene import Scene
from mmt.scene_files import load_scene
from mmt.session import read_session


class Instrument:
    """A device that notes its life and fails where it is told to."""

    def __init__(self, value: float = 0.0, **failures: Exception) -> None:
        self.value = value
        self.failures = failures
        self.calls: list[str] = []
        self.written: list[Vector] = []

    def _do(self, name: str) -> None:
        self.calls.append(name)
        if name in self.failures:
            raise self.failures[name]

    def connect(self) -> None:
        self._do("connect")

    def calibrate(self) -> None:
        self._do("calibrate")

    def close(self) -> None:
        self._do("close")

    def read(self) -> Vector:
        self._do("read")
        return (self.value, self.value + 1, self.value + 2)

    def write(self, position_mm: Vector) -> None:
        self._do("write")
        self.written.append(position_mm)


def made(**failures: Exception) -> tuple[DeviceSource, list[Instrument]]:
    devices = [Instrument(10.0), Instrument(20.0), Instrument(30.0, **failures)]
    return DeviceSource(*devices, CHANNELS), devices


def test_every_device_is_read_once_a_tick() -> None:
    source, devices = made()
    source.start(0)
    blocks = [source.step(1, 1000 + k, None) for k in range(3)]
    frames = np.concatenate(blocks)
    assert frames["sequence"].tolist() == [0, 1, 2]
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


def test_ticks_begin_after_the_turn_of_a_device_that_has_turns() -> None:
    class Paced(Instrument):
        def await_turn(self) -> None:
            self._do("await_turn")

    robot = Paced()
    source = DeviceSource(robot, Instrument(), Instrument(), CHANNELS)
    source.start(0)
    assert robot.calls == ["connect", "calibrate", "await_turn"]


def test_a_frame_that_comes_between_two_ticks_is_sent_at_once(tmp_path: Path) -> None:
    class Source(DeviceSource):
        def hand_on(self, callback: FrameTaker) -> None:
            self.taker = callback

    class News:
        def measured(self, frames: RecordArray) -> RecordArray:
            return frames[:0]

    source = Source(*[Instrument() for _ in range(3)], CHANNELS)
    sent: list[tuple[RecordArray, RecordArray | None]] = []

    def send(frames: RecordArray, news: RecordArray | None) -> None:
        sent.append((frames, news))

    for feedback in (None, News()):
        driven = DrivenSource(small_scene(tmp_path), source, feedback, print, send)
        source.start(0)
        frames = source.step(1, 1000, None)
        source.taker(frames)
        assert sent[-1][0] is frames
        assert (sent[-1][1] is None) == (feedback is None)
        assert driven._measured() == (0.0, 1.0, 2.0)


def test_ticks_that_were_missed_show_as_a_gap() -> None:
    source, _ = made()
    source.start(0)
    frames = np.concatenate([source.step(elapsed, 0, None) for elapsed in (1, 1, 4, 1)])
    assert frames["sequence"].tolist() == [0, 1, 5, 6]


def test_the_robot_is_commanded_before_it_is_read() -> None:
    source, (robot, *_) = made()
    source.step(1, 0, None)
    source.step(1, 0, (1.0, 2.0, 3.0))
    assert robot.calls == ["read", "write", "read"]
    assert robot.written == [(1.0, 2.0, 3.0)]


def test_only_the_channels_of_the_scene_are_read() -> None:
    robot, force_sensor = Instrument(), Instrument()
    source = DeviceSource(robot, force_sensor, None, ("force",))
    frames = source.step(1, 0, (0.0, 0.0, 0.0))
    assert frames.dtype.names == ("sequence", "time_ns", "force_n")
    assert robot.calls == ["write"]
    assert force_sensor.calls == ["read"]


@pytest.mark.parametrize(
    ("channel", "key"), [("force", "force_sensor"), ("acceleration", "accelerometer")]
)
def test_a_channel_without_a_device_is_explained(channel: str, key: str) -> None:
    with pytest.raises(InputError, match=rf"\[devices\] has no {key}, .* needs {channel}"):
        DeviceSource(Instrument(), None, None, ("position", channel))  # type: ignore[arg-type]


@pytest.mark.parametrize("call", ["connect", "calibrate"])
def test_a_device_that_does_not_answer_is_named(call: str) -> None:
    source, _ = made(**{call: OSError(5, "Input/output error")})
    with pytest.raises(MmtError, match=r"the accelerometer \(Instrument\) failed: .*Input/output"):
        source.start(0)


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError(19, "No such device"), "No such device"),
        (ValueError(), "ValueError"),
        (MmtError("cable 3 is loose"), "cable 3 is loose"),
    ],
)
def test_a_device_that_fails_is_named_whatever_its_driver_raises(
    error: Exception, reason: str
) -> None:
    source, _ = made(read=error)
    source.start(0)
    with pytest.raises(MmtError, match=rf"the accelerometer \(Instrument\) failed: .*{reason}"):
        source.step(1, 0, None)


def test_a_reading_of_the_wrong_size_is_the_devices_fault() -> None:
    class Flat(Instrument):
        def read(self) -> Any:
            return (1.0, 2.0)

    source = DeviceSource(Flat(), None, None, ("position",))
    with pytest.raises(MmtError, match=r"the robot \(Flat\) failed"):
        source.step(1, 0, None)


def test_all_are_closed_when_one_does_not_close() -> None:
    devices = [Instrument(close=OSError("stuck")), Instrument(), Instrument(close=OSError("gone"))]
    source = DeviceSource(*devices, CHANNELS)
    with pytest.raises(MmtError, match=r"robot .*stuck; the accelerometer .*gone"):
        source.close()
    assert [device.calls for device in devices] == [["close"]] * 3


# --- loading


@pytest.fixture
def drivers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "lab_drivers.py").write_text(
        "from test_device_source import Instrument as Robot, Instrument as Force\n"
        "from mmt.errors import MmtError\n"
        "number = 3\n"
        "def absent():\n    raise OSError('no such port')\n"
        "def explained():\n    raise MmtError('switch it on')\n"
    )
    (tmp_path / "broken_drivers.py").write_text("raise OSError('libHD.so is missing')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    return "lab_drivers"


def test_a_device_is_made_by_its_factory(drivers: str) -> None:
    assert load_device(f"{drivers}:Robot").read() == (0.0, 1.0, 2.0)


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
def test_a_device_that_cannot_be_had_is_explained(
    drivers: str, name: str, kind: type[MmtError], sentence: str
) -> None:
    with pytest.raises(kind, match=sentence) as caught:
        load_device(name)
    assert type(caught.value) is kind


async def test_a_scene_of_devices_streams_what_they_measure(tmp_path: Path, drivers: str) -> None:
    table = {"robot": f"{drivers}:Robot", "force_sensor": f"{drivers}:Force"}
    table["accelerometer"] = f"{drivers}:Robot"
    together = Together.of(small_scene(tmp_path, devices=table, simulated=None))
    await together.listen()
    following = asyncio.create_task(together.follow())
    await together.until(lambda: together.leader.time_s > 0.2)
    together.leader.stop()
    assert (await together.end()).problem is None
    assert (await following).problem is None
    frames = read_session(tmp_path / "session.mcap").frames
    assert len(frames) > 20
    assert (frames["force_n"] == (0.0, 1.0, 2.0)).all()
    assert (np.diff(frames["time_ns"]) > 0).all()


class Slow(Instrument):
    """A device whose connection takes as long as the test wants."""

    goes_on: ClassVar[threading.Event]
    made: ClassVar[list[Any]]

    def __init__(self) -> None:
        super().__init__()
        self.made.append(self)

    def connect(self) -> None:
        assert self.goes_on.wait(20.0), "the loop that would let it go on stands still"


@pytest.fixture
def slow_scene(tmp_path: Path, drivers: str) -> Scene:
    (tmp_path / "slow_drivers.py").write_text("from test_device_source import Slow as Robot\n")
    Slow.goes_on, Slow.made = threading.Event(), []
    table = {"robot": "slow_drivers:Robot", "force_sensor": f"{drivers}:Force"}
    table["accelerometer"] = f"{drivers}:Robot"
    return small_scene(tmp_path, devices=table, simulated=None)


async def test_the_leader_is_answered_while_devices_are_connected(slow_scene: Scene) -> None:
    together = Together.of(slow_scene)
    await together.listen()
    following = asyncio.create_task(together.follow())
    before = together.leader.ticker.statistics.ticks
    await together.until(lambda: together.leader.ticker.statistics.ticks > before + 300)
    assert together.leader.status().frames == 0
    Slow.goes_on.set()
    await together.until(lambda: together.leader.status().frames > 20)
    together.leader.stop()
    assert (await together.end()).problem is None
    assert (await following).problem is None


async def test_a_session_that_ends_while_devices_are_connected_closes_them(
    slow_scene: Scene,
) -> None:
    together = Together.of(slow_scene)
    await together.listen()
    following = asyncio.create_task(together.follow())
    await together.until(lambda: any("follower connected" in said for said in together.said))
    together.leader.stop()
    assert (await together.end()).problem is None
    Slow.goes_on.set()
    assert (await following).problem is None
    assert [device.calls for device in Slow.made] == [["calibrate", "close"]]


# --- a sensor on a clock of its own


class OwnClock:
    """A force sensor of 2 kHz on a clock of its own, that can be unplugged while it runs."""

    made: ClassVar[list[Any]] = []

    def __init__(self, force_n: float = 1.0) -> None:
        self.latency_ns = 0
        self.faults: dict[str, int] = {}
        self.force_n = force_n
        self.unplugged = False
        self.made.append(self)

    def connect(self) -> None:
        if self.unplugged:
            raise MmtError("the cable is out")
        self._begun_ns = self._read_to_ns = time.monotonic_ns()

    def calibrate(self) -> None:
        pass

    def read(self) -> list[SensorReading]:
        if self.unplugged:
            raise DeviceLost("the cable is out")
        now_ns = time.monotonic_ns()
        stamps = range(self._read_to_ns, now_ns, 500_000)
        self._read_to_ns = stamps[-1] + 500_000 if stamps else self._read_to_ns
        return [SensorReading(t - self._begun_ns, (0.0, 0.0, self.force_n)) for t in stamps]

    def close(self) -> None:
        pass


def device_scene(tmp_path: Path, drivers: str, on_lost: str) -> Scene:
    (tmp_path / "own_clock.py").write_text("from test_device_source import OwnClock as Force\n")
    OwnClock.made.clear()
    table = {
        "robot": f"{drivers}:Robot",
        "force_sensor": {"driver": "own_clock:Force", "force_n": 2.5},
        "accelerometer": f"{drivers}:Robot",
        "on_lost": on_lost,
    }
    return small_scene(tmp_path, devices=table, simulated=None)


async def test_a_session_survives_a_sensor_that_is_unplugged_and_plugged_again(
    tmp_path: Path, drivers: str
) -> None:
    together = Together.of(device_scene(tmp_path, drivers, "hold"))
    await together.listen()
    following = asyncio.create_task(together.follow())
    await together.until(lambda: together.leader.time_s > 0.3)
    (sensor,) = OwnClock.made
    sensor.unplugged = True
    await together.until(lambda: any("is lost: the cable is out: hold" in s for s in together.said))
    sensor.unplugged = False
    await together.until(lambda: any("force sensor (OwnClock) is back" in s for s in together.said))
    back_s = together.leader.time_s
    await together.until(lambda: together.leader.time_s > back_s + 0.3)
    together.leader.stop()
    assert (await together.end()).problem is None
    summary = await following
    assert summary.problem is None
    assert summary.commands["halts"] == 1
    assert summary.devices["force_sensor"]["losses"] == 1
    frames = read_session(tmp_path / "session.mcap").frames
    assert (frames["force_n"] == (0.0, 0.0, 2.5)).all()
    assert np.diff(frames["sequence"].astype(np.int64)).max() >= 50
    assert (np.diff(frames["time_ns"]) > 0).all()


async def test_a_session_ends_with_its_recording_kept_where_the_scene_says_stop(
    tmp_path: Path, drivers: str
) -> None:
    together = Together.of(device_scene(tmp_path, drivers, "stop"))
    await together.listen()
    following = asyncio.create_task(together.follow())
    await together.until(
        lambda: together.leader.time_s > 0.3 and together.leader.status().frames > 20
    )
    OwnClock.made[0].unplugged = True
    summary = await following
    assert summary.problem is not None
    assert "the force sensor (OwnClock) failed: the cable is out" in summary.problem
    assert "the cable is out" in str((await together.end()).problem)
    assert len(read_session(tmp_path / "session.mcap").frames) > 20


async def test_the_virtual_lab_carries_the_main_job_over_its_devices(tmp_path: Path) -> None:
    changes = {
        "link.port": 0,
        "recording.file": str(tmp_path / "session.mcap"),
        "session.duration_s": 100.0,  # on a busy machine frames are rare
    }
    together = Together.of(load_scene(Path("virtual-lab"), changes))
    await together.listen()
    following = asyncio.create_task(together.follow())
    await together.until(
        lambda: together.leader.time_s > 2.0 and together.leader.status().frames > 200
    )
    together.leader.stop()
    assert (await together.end()).problem is None
    summary = await following
    assert summary.problem is None
    assert summary.devices["force_sensor"]["readings"] > 500
    assert summary.devices["accelerometer"]["readings"] > 500
    frames = read_session(tmp_path / "session.mcap").frames
    assert len(frames) > 200
    assert np.median(np.linalg.norm(frames["acceleration_m_s2"], axis=1)) == pytest.approx(
        10, abs=2
    )
    assert frames["force_n"][:, 2].max() > 0.1  # the hand has pressed on the surface
    assert np.ptp(frames["position_mm"][:, 2]) > 4.0


def test_a_source_of_devices_is_known_by_its_protocol(tmp_path: Path) -> None:
    source, _ = made()
    assert isinstance(source, DeviceBackedSource)
    assert not isinstance(build_source(small_scene(tmp_path)), DeviceBackedSource)
