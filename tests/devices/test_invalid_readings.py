"""Readings that are no measurement, of every role and kind of sensor: no frame has them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_sensors import MS, SyntheticSensor, Time

from mmt.core.errors import DeviceLost, MmtError
from mmt.core.frames import ALL_CHANNELS
from mmt.core.units import LARGEST_QUANTITY
from mmt.devices.protocols import SensorReading
from mmt.devices.streaming import slots as slots_module
from mmt.devices.streaming import source as source_module
from mmt.devices.streaming.source import DeviceSource
from mmt.link.incoming import BlockReader

BAD = st.sampled_from([math.nan, math.inf, -math.inf, 1e39, -1.01 * LARGEST_QUANTITY])
KEYS = {"force": "force_sensor", "acceleration": "accelerometer"}


class Polled:
    """A robot, or a sensor that is asked at each tick, which gives nonsense for some time."""

    def __init__(self):
        self.wrong = None
        self.turn = (1.0, 0.0, 0.0, 0.0)

    def connect(self): ...

    def calibrate(self): ...

    def close(self): ...

    def write(self, position_mm): ...

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


class Bench:
    """A source in simulated time; its frames are read as a leader reads them."""

    def __init__(self, patch, sampled, samples=1, on_lost="hold"):
        self.time = Time()
        patch.setattr(source_module, "time", self.time)
        patch.setattr(slots_module, "time", self.time.still)
        force = Sampled(2000, time=self.time) if "force" in sampled else Polled()
        acceleration = Sampled(4000, time=self.time) if "acceleration" in sampled else Polled()
        self.devices = {"robot": Polled(), "force": force, "acceleration": acceleration}
        self.told = []
        self.source = DeviceSource(
            *self.devices.values(), ALL_CHANNELS, on_lost=on_lost, samples_per_frame=samples
        )
        self.source.on_loss(lambda lost, sentence: self.told.append((lost, sentence)))
        self.source.start(0)

    def run(self, ticks):
        frames = []
        for _ in range(ticks):
            self.time.now_ns += MS
            frames.append(self.source.step(1, self.time.now_ns, None))
        return np.concatenate(frames)


@given(
    role=st.sampled_from(["robot", "force", "acceleration", "orientation"]),
    sampled=st.sets(st.sampled_from(["force", "acceleration"])),
    several=st.booleans(),
    bad=BAD,
    axis=st.integers(0, 2),
    lasting=st.integers(1, 12),
)
@settings(max_examples=60, deadline=None)
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
@settings(max_examples=30, deadline=None)
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
    assert [lost for lost, _ in bench.told] == [True]
    vars(force).update(dict.fromkeys(nonsense))
    bench.run(20)
    assert bench.told[-1] == (False, "the force sensor (Sampled) is back")
    force.error = DeviceLost("gone")
    bench.run(2)
    assert bench.source.summary["force_sensor"]["losses"] == 2
