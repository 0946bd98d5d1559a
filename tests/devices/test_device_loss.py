"""A device that is lost: how soon it is seen, what is said, and that it comes back."""

import time as real_time

import numpy as np
import pytest
from instruments import Instrument
from synthetic_sensors import MS, SteppedSource, SyntheticSensor, simulated_time
from waiting import until

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.protocols import SensorReading
from mmt.devices.reconnection import OperatorHandle, Reasons, ReconnectingActuator, Reconnection
from mmt.devices.streaming.slots import SampledSlot
from mmt.devices.streaming.source import DeviceSource


class Arm(Instrument):
    """A robot that can be unplugged."""

    lost = False

    def connect(self):
        super().connect()
        if self.lost:
            raise MmtError("still unplugged")

    def read(self):
        if self.lost:
            raise DeviceLost("the arm does not answer")
        return super().read()


@pytest.fixture
def time(monkeypatch):
    return simulated_time(monkeypatch)


class Bench(SteppedSource):
    """A source of a robot and a force sensor."""

    def __init__(self, time, on_lost="hold", rate_hz=2000):
        self.arm = Arm()
        self.sensor = SyntheticSensor(rate_hz, time=time)
        devices = self.arm, self.sensor, None
        super().__init__(time, *devices, channels=("position", "force"), on_lost=on_lost)

    def run_until_back(self):
        """Tick until nothing is lost; return the ticks.  Connecting takes real time."""
        began_ns = self.time.now_ns
        until(lambda: not self.told[-1][0], lambda: self.run(1))
        return (self.time.now_ns - began_ns) // MS


@pytest.fixture
def bench(time):
    made = Bench(time)
    yield made
    made.source.close()


def test_a_sensor_that_stops_is_seen_within_20_ms_and_frames_cease(bench):
    assert len(bench.run(100)) >= 95
    bench.sensor.stalled = True
    bench.run(20)
    assert [lost for lost, *_ in bench.told] == [True]
    assert "the force sensor (SyntheticSensor) is lost: no reading for 1" in bench.told[0][1]
    assert "cable" in bench.told[0][1]
    assert len(bench.run(50)) == 0
    assert len(bench.arm.written) == 170  # the robot is commanded all the while


@pytest.mark.parametrize("rate_hz", [30.0, 2.0])
def test_a_sensor_with_a_slow_rate_is_lost_by_its_own_period(time, rate_hz):
    bench = Bench(time, rate_hz=rate_hz)
    period_ms = round(1000 / rate_hz)
    assert len(bench.run(10 * period_ms)) >= 8 * period_ms
    assert bench.told == []
    bench.sensor.stalled = True
    bench.run(3 * period_ms + 3)
    assert [lost for lost, *_ in bench.told] == [True]
    bench.sensor.stalled = False
    bench.run(2 * period_ms)
    assert not bench.told[-1][0]
    assert bench.sensor.calls == ["connect", "calibrate"]  # it was merely silent
    bench.source.close()


def test_a_short_silence_ends_without_a_new_connection_and_a_long_one_with_it(bench):
    before = bench.run(100)
    bench.sensor.stalled = True
    bench.run(60)
    bench.sensor.stalled = False
    assert bench.run_until_back() < 5  # its clock is still known
    assert bench.sensor.calls == ["connect", "calibrate"]
    after = bench.run(50)
    assert len(after) >= 49
    assert after["sequence"][0] >= before["sequence"][-1] + 60
    error_ms = after["force_n"][:, 0] - (after["time_ns"] - after["time_ns"][0]) / 1e6
    assert np.ptp(error_ms) < 0.1
    bench.sensor.stalled = True
    bench.run(350)
    until(lambda: bench.sensor.calls.count("connect") > 1)  # made by a thread of its own
    bench.sensor.stalled = False
    bench.run_until_back()
    assert bench.sensor.calls.count("calibrate") == 1  # the tool may touch the surface
    assert len(bench.run(20)) >= 19
    assert bench.source.summary["force_sensor"]["losses"] == 2


def test_an_unplugged_sensor_comes_back_when_it_can_be_connected(time):
    bench = Bench(time, "retract")
    bench.run(50)
    bench.sensor.connect_error = MmtError("no such slot")
    bench.sensor.error = DeviceLost("unplugged")
    assert len(bench.run(100)) <= 1
    until(lambda: len(bench.told) > 1, lambda: bench.run(1))  # connecting takes real time
    assert bench.told == [
        (True, "the force sensor (SyntheticSensor) is lost: unplugged", False),
        (True, "the force sensor (SyntheticSensor) is not back yet: no such slot", False),
    ]
    bench.sensor.connect_error = None
    bench.run_until_back()
    assert bench.told[-1] == (False, "the force sensor (SyntheticSensor) is back", False)
    assert len(bench.run(20)) >= 19
    bench.source.close()


@pytest.mark.parametrize("error", [AttributeError("it has no port"), OSError(9, "bad file")])
def test_whatever_a_lost_sensor_raises_it_is_connected_again(bench, error):
    bench.run(100)
    bench.sensor.error = DeviceLost("the cable is out")
    bench.run(1)
    bench.sensor.error = error  # as a driver does that has let go of its port
    bench.run_until_back()
    assert bench.sensor.calls.count("connect") == 2
    assert len(bench.run(100)) >= 90


def test_a_lost_robot_comes_back_too(bench):
    bench.run(50)
    bench.arm.lost = True
    assert len(bench.run(30)) == 0
    assert bench.told[0] == (True, "the robot (Arm) is lost: the arm does not answer", True)
    bench.arm.lost = False
    bench.run_until_back()
    assert len(bench.run(20)) >= 15
    assert bench.arm.calls[:2] == ["connect", "calibrate"]


def test_a_lost_device_ends_the_session_where_the_scene_says_stop(time):
    bench = Bench(time, "stop")
    bench.run(50)
    bench.sensor.stalled = True
    with pytest.raises(MmtError, match=r"the force sensor \(SyntheticSensor\) failed: no reading"):
        bench.run(20)
    assert bench.told == []


def test_a_latency_that_is_known_once_connected_is_taken(time, monkeypatch):
    def connect(sensor):
        sensor.latency_ns = 2 * MS

    monkeypatch.setattr(SyntheticSensor, "connect", connect)
    newest_ns = Bench(time).run(100)["time_ns"][-1]
    assert time.now_ns - newest_ns == pytest.approx(3.5 * MS, abs=MS)


def test_what_a_probe_finds_is_told_by_the_next_tick_and_a_host_held_up_loses_nothing(bench):
    bench.run(50)
    bench.run(5, elapsed=40)
    assert bench.told == []
    bench.sensor.error = DeviceLost("unplugged")
    bench.source.probe(bench.time.now_ns)
    bench.sensor.error = None
    assert bench.told == []
    bench.run(1)
    assert bench.told == [(True, "the force sensor (SyntheticSensor) is lost: unplugged", False)]


def test_a_frame_whose_reading_just_missed_its_tick_comes_between_two_ticks(bench, monkeypatch):
    blocks = [bench.run(50)]
    late = []
    bench.source.on_late_frames(late.append)
    hold_back_ns = bench.time.now_ns - int(blocks[-1]["time_ns"][-1])
    under_way_ns = hold_back_ns - 150_000  # and 0.2 ms that it states itself
    monkeypatch.setattr(
        bench.sensor, "read", lambda: bench.sensor.arrived(bench.time.now_ns - under_way_ns)
    )
    for _ in range(100):
        blocks.append(bench.run(1))
        bench.time.now_ns += 900_000
        lacking = bench.source.retry(bench.time.now_ns)
        assert lacking != bool(late)
        blocks += late
        late.clear()
        bench.time.now_ns -= 900_000
    frames = np.concatenate(blocks)
    assert len(frames) >= 140  # ten of a hundred readings may be later still
    assert sum(len(block) == 0 for block in blocks) > 80  # those of ticks
    assert np.all(np.diff(frames["sequence"]) == 1)
    assert np.all(np.diff(frames["time_ns"]) == MS)


def test_a_sensor_that_knows_when_its_readings_came_is_believed():
    class Stamping(SyntheticSensor):
        arrival_ns = 0

        def read(self):
            self.arrival_ns = real_time.monotonic_ns() - 5 * MS
            return [SensorReading(1000, (1.0, 2.0, 3.0))]

    sensor = Stamping(1000)
    slot = SampledSlot("force sensor", sensor)
    assert slot.stamping is not None
    assert SampledSlot("force sensor", SyntheticSensor(1000)).stamping is None
    assert slot.poll()
    assert slot.lane.clock.sensor_time(sensor.arrival_ns) == 1000


def test_a_sensor_that_gives_nothing_at_the_start_is_explained(time):
    sensor = SyntheticSensor(1000, time=time)
    sensor.stalled = True
    source = DeviceSource(Arm(), sensor, None, ("force",))
    with pytest.raises(MmtError, match=r"force sensor .* gives no reading; check its cable"):
        source.start(0)


def test_a_reading_that_comes_while_the_tick_is_held_up_did_not_come_before_it_was_measured(
    time, monkeypatch
):
    sensor = SyntheticSensor(1000, time=time)

    def read():
        time.now_ns += 5 * MS  # another process has the core
        return [SensorReading(7_000_000_000, (0.0, 0.0, 0.0))]

    monkeypatch.setattr(sensor, "read", read)
    slot = SampledSlot("force sensor", sensor)
    tick_ns = time.now_ns
    slot.step(tick_ns, None)
    assert slot.lane.clock.sensor_time(tick_ns + 5 * MS) <= 7_000_000_000


def test_why_a_device_is_not_back_is_told_once_for_each_reason():
    reasons = Reasons("no reading for 15 ms")
    assert [reasons.new(f"no reading for {n} ms") for n in (16, 17.5)] == ["", ""]
    assert [reasons.new(f"no slot {n}") for n in (1, 2)] == ["no slot 1", ""]
    assert reasons.new("") == ""
    told = [reasons.new(f"reason {'x' * n}") for n in range(100)]
    assert len([reason for reason in told if reason]) < 6


class Stuck:
    """Cannot be closed once it is lost; connects at the second try."""

    tries = 0

    def close(self):
        raise OSError("the handle is gone")

    def connect(self):
        self.tries += 1
        if self.tries < 2:
            raise SystemExit("not yet")  # as some vendors' programs do


def test_a_device_that_cannot_be_closed_is_connected_all_the_same():
    device = Stuck()
    reconnection = Reconnection(device)
    assert reconnection.done.wait(20.0)
    assert (device.tries, reconnection.reason) == (2, "not yet")


class Mute(Instrument):
    """Can always be connected, and answers so many times after that."""

    def __init__(self, answers=0):
        super().__init__()
        self._answers = answers
        self.connected_s = []

    def connect(self):
        self.connected_s.append(real_time.monotonic())
        self._left = self._answers

    def read(self, elapsed_ticks=1):
        self._left -= 1
        if self._left < 0:
            raise DeviceLost("it does not answer")
        return (0.0, 0.0, 0.0)

    def write(self, samples_m_s2):
        self.read()


def of_follower(device, told):
    """Return its owner, and a look at it."""
    source = DeviceSource(device, None, None, ("position",), on_lost="hold")
    source.on_loss(lambda _, sentence, __: told.append(sentence))
    source.start(0)
    return source, lambda: source.step(1, real_time.monotonic_ns(), None)


def of_leader(wrapped, told):
    wrapped.watch(lambda sentence, **_: told.append(sentence))
    wrapped.connect()
    is_handle = isinstance(wrapped, OperatorHandle)
    return wrapped, lambda: wrapped.read(1) if is_handle else wrapped.write([0.0])


@pytest.mark.parametrize(
    ("kind", "answers"),
    [
        *((of_follower, answers) for answers in (0, 1, 3)),
        (lambda device, told: of_leader(OperatorHandle(device, 1.0), told), 0),
        (lambda device, told: of_leader(ReconnectingActuator(device), told), 0),
    ],
    ids=["follower", "answers once", "answers thrice", "handle", "actuator"],
)
def test_a_device_that_connects_and_does_not_answer_is_not_connected_all_the_time(kind, answers):
    device, told = Mute(answers), []
    owner, look = kind(device, told)
    while len(device.connected_s) < 3:
        look()
        real_time.sleep(0.001)
    owner.close()
    _, first_s, second_s = device.connected_s  # the first try comes at once
    assert second_s - first_s > 0.4
    assert len(told) < 10
