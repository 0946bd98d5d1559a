"""One device of a follower: what is taken of it at a tick, and what is left out."""

import math
import time
from collections.abc import Mapping

import numpy as np
import pytest
import running_source
from instruments import Instrument

from mmt.devices.protocols import SensorReading
from mmt.devices.streaming.slots import RobotSlot, SampledSlot
from mmt.devices.streaming.source import DeviceSource

MS = 1_000_000


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
    assert slot.summary == {"device": "Arm", "losses": 0}
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


@pytest.mark.parametrize("broken", ["position", "force", "acceleration"])
def test_one_devices_invalid_readings_leave_out_their_frames_and_are_told_once(broken, caplog):
    devices = {name: Instrument(20.0) for name in ("position", "force", "acceleration")}
    source = DeviceSource(*devices.values(), tuple(devices))
    source.start(0)
    blocks = []
    for tick in range(12):
        devices[broken].value = math.nan if tick in {3, 4, 8} else 20.0
        blocks.append(source.step(1, MS * tick, None))
    frames = np.concatenate(blocks)
    assert frames["sequence"].tolist() == [0, 1, 2, 5, 6, 7, 9, 10, 11]
    assert all(np.isfinite(frames[name]).all() for name in frames.dtype.names)
    role = {"position": "robot", "force": "force_sensor", "acceleration": "accelerometer"}[broken]
    faulty = {name for name, counts in source.summary.items() if "faults" in counts}
    assert faulty == {role}
    assert source.summary[role]["faults"] == {"invalid_readings": 3}
    (said,) = [record.getMessage() for record in caplog.records]
    assert said.startswith(f"the {role.replace('_', ' ')} (")
