"""What is taken of a device, and what is left out: no frame has what is no measurement."""

import math
import time
from collections.abc import Mapping

import numpy as np
import pytest
import running_source
from hypothesis import given, settings
from hypothesis import strategies as st
from instruments import Instrument
from synthetic_sensors import MS, SteppedSource, SyntheticSensor, simulated_time

from mmt.core.errors import DeviceLost, MmtError
from mmt.core.frames import ALL_CHANNELS, LARGEST_QUANTITY
from mmt.devices.protocols import SensorReading
from mmt.devices.streaming.slots import RobotSlot, SampledSlot
from mmt.devices.streaming.source import DeviceSource
from mmt.link.incoming import BlockReader

BAD = st.sampled_from([math.nan, math.inf, -math.inf, 1e39, -1.01 * LARGEST_QUANTITY])
KEYS = {"force": "force_sensor", "acceleration": "accelerometer"}


class Polled(running_source.Arm):
    """A robot, or a sensor that is asked at each tick, which gives nonsense for some time."""

    def __init__(self):
        self.wrong = None
        self.turn = (1.0, 0.0, 0.0, 0.0)

    def read(self):
        return self.wrong or (1.0, 2.0, 3.0)

    def orientation(self):
        return self.turn


class Sampled(SyntheticSensor):
    """A sensor with a clock of its own, which gives nonsense for some time."""

    wrong = stamp = None

    def read(self):
        return [
            SensorReading(time_ns if self.stamp is None else self.stamp, self.wrong or value)
            for time_ns, value in super().read()
        ]


class Bench(SteppedSource):
    """A source of all that there is; some of its sensors have clocks of their own."""

    def __init__(self, patch, sampled, samples=1):
        time = simulated_time(patch)
        force = Sampled(2000, time=time) if "force" in sampled else Polled()
        acceleration = Sampled(4000, time=time) if "acceleration" in sampled else Polled()
        self.devices = {"robot": Polled(), "force": force, "acceleration": acceleration}
        super().__init__(time, *self.devices.values(), channels=ALL_CHANNELS, samples=samples)


@given(
    role=st.sampled_from(["robot", "force", "acceleration", "orientation"]),
    sampled=st.sets(st.sampled_from(["force", "acceleration"])),
    several=st.booleans(),
    bad=BAD,
    axis=st.integers(0, 2),
    lasting=st.integers(1, 12),
)
@settings(max_examples=60)
def test_no_frame_has_a_reading_that_is_no_measurement(role, sampled, several, bad, axis, lasting):
    samples = 4 if several and "acceleration" in sampled else 1
    values = [1.0, 2.0, 3.0, 0.0]
    values[axis] = bad
    with pytest.MonkeyPatch.context() as patch:
        bench = Bench(patch, sampled, samples)
        before = bench.run(50)
        if role == "orientation":
            bench.devices["robot"].turn = tuple(values)
        else:
            bench.devices[role].wrong = tuple(values[:3])
        during = bench.run(lasting)
        bench.devices["robot"].turn = (1.0, 0.0, 0.0, 0.0)
        for device in bench.devices.values():
            device.wrong = None
        after = bench.run(50)
    frames = np.concatenate((before, during, after))
    reader = BlockReader(frames.dtype, "frames")
    for k in range(len(frames)):
        assert reader.read((frames[k : k + 1].tobytes(),), int(frames["time_ns"][k])) is not None
    assert not reader.rejected
    assert len(after) > 30  # it goes on as soon as there are measurements
    kind = "invalid_orientations" if role == "orientation" else "invalid_readings"
    for key, summary in bench.source.summary.items():
        count = summary.get("faults", {}).get(kind, 0)
        assert (count >= lasting) == (KEYS.get(role, "robot") == key)


@given(
    sensor=st.sampled_from(["force", "acceleration"]),
    several=st.booleans(),
    stamp=st.sampled_from([math.nan, math.inf, -math.inf, 0]),
    lasting=st.integers(1, 12),
)
@settings(max_examples=30)
def test_a_reading_without_a_time_of_its_own_is_left_out(sensor, several, stamp, lasting):
    with pytest.MonkeyPatch.context() as patch:
        bench = Bench(patch, {sensor}, 4 if several and sensor == "acceleration" else 1)
        bench.run(50)
        bench.devices[sensor].stamp = stamp
        during = bench.run(lasting)
        bench.devices[sensor].stamp = None
        after = bench.run(50)
    frames = np.concatenate((during, after))
    for name in frames.dtype.names:
        assert np.isfinite(frames[name]).all()
    assert (np.diff(frames["time_ns"]) > 0).all()
    assert len(after) > 30
    assert bench.source.summary[KEYS[sensor]]["faults"]["invalid_readings"] >= lasting


@pytest.mark.parametrize("latency_ns", [math.nan, math.inf, None])
def test_a_sensor_whose_latency_is_no_number_is_named(latency_ns, monkeypatch):
    told = property(lambda _: latency_ns, lambda *_: None)
    monkeypatch.setattr(Sampled, "latency_ns", told, raising=False)
    monkeypatch.setattr(Sampled, "wrong", (1.0, 2.0, 3.0))
    with pytest.raises(MmtError, match=r"the force sensor \(Sampled\) failed"):
        Bench(monkeypatch, {"force"})


@pytest.mark.parametrize("nonsense", [{"wrong": (math.nan,) * 3}, {"stamp": 0}])
def test_a_sensor_that_gives_nothing_but_nonsense_is_lost_and_comes_back(nonsense, monkeypatch):
    bench = Bench(monkeypatch, {"force"})
    bench.run(50)
    force = bench.devices["force"]
    vars(force).update(nonsense)
    assert not len(bench.run(60)[20:])
    assert [lost for lost, *_ in bench.told] == [True]
    vars(force).update(dict.fromkeys(nonsense))
    bench.run(20)
    assert bench.told[-1] == (False, "the force sensor (Sampled) is back", False)
    force.error = DeviceLost("gone")
    bench.run(2)
    assert bench.source.summary["force_sensor"]["losses"] == 2


class Arm(running_source.Arm):
    """A robot that goes 1 mm in a millisecond."""

    now_ns = 0
    faults: Mapping[str, int] = {}

    def read(self):
        return (self.now_ns / MS, 0.0, 0.0)


class MeasuredArm(Arm):
    """One that is measured every two milliseconds, beside the ticks."""

    asked = 0

    def positions(self, after_ns, until_ns):
        self.asked += 1
        times = range(after_ns - after_ns % (2 * MS) + 2 * MS, until_ns, 2 * MS)
        return [(time_ns, (time_ns / MS, 0.0, 0.0)) for time_ns in times]


def ticked(arm, ticks_ms):
    slot = RobotSlot("robot", arm, measures=True)
    for tick in ticks_ms:
        arm.now_ns = tick * MS
        slot.step(arm.now_ns, None)
    return slot


def test_positions_of_while_ticks_were_held_up_are_taken_where_the_driver_keeps_them():
    held_up = [100, 101, 102, 140, 141]
    assert ticked(Arm(), held_up).lane.at(121 * MS) is None
    arm = MeasuredArm()
    assert ticked(arm, held_up).lane.at(121 * MS) == pytest.approx((121.0, 0.0, 0.0))
    assert arm.asked == 2  # at the first tick, and after the pause


def test_what_a_robots_driver_has_survived_is_in_its_summary():
    arm = Arm()
    slot = RobotSlot("robot", arm, measures=True)
    assert slot.summary == {"device": "Arm", "losses": 0, "missed_frames": 0}
    arm.faults = {"commands that are not finite": 2}
    assert slot.summary["faults"] == {"commands that are not finite": 2}


class BufferedSensor:
    """A sensor whose readings have waited in a buffer, a hundred a read, since it was connected."""

    latency_ns = 0
    faults: dict[str, int] = {}  # noqa: RUF012 - of a driver

    def __init__(self, nothing):
        self._nothing = nothing
        self._reads = [self._batch(time.monotonic_ns() - (8 - k) * 100 * MS) for k in range(8)]

    def connect(self):
        """It is there."""

    calibrate = close = connect

    def _batch(self, begun_ns):
        return [SensorReading(begun_ns + k * MS, (float(k), 0.0, 0.0)) for k in range(100)]

    def read(self):
        return self._reads.pop(0) if self._reads else self._nothing

    def measure(self):
        self._reads.append([SensorReading(time.monotonic_ns(), (1.0, 2.0, 3.0))])


@pytest.mark.parametrize("nothing", [(), [], None])
def test_what_has_waited_since_a_sensor_was_connected_moves_no_clock(nothing):
    sensor = BufferedSensor(nothing)
    slot = SampledSlot("force sensor", sensor)
    assert not slot.poll()
    for _ in range(20):
        sensor.measure()
        assert slot.poll()
    assert slot.lane.readings == 20
    assert slot.lane.clock.jumps == 0


def test_invalid_readings_are_told_once(caplog):
    robot = Instrument(20.0)
    source = DeviceSource(robot, None, None, ("position",))
    source.start(0)
    for tick in range(12):
        robot.value = math.nan if tick in {3, 4, 8} else 20.0
        source.step(1, MS * tick, None)
    assert source.summary["robot"]["faults"] == {"invalid_readings": 3}
    (said,) = caplog.messages
    assert said.startswith("the robot (")
