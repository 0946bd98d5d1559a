"""Merging sensors on clocks of their own: time errors, latencies, gaps, cost."""

import math
import random
import time

import numpy as np
import pytest
from synthetic_sensors import MS, START_NS, SyntheticSensor

from mmt.core.frames import frame_dtype
from mmt.devices.protocols import SensorReading
from mmt.devices.streaming.frame_assembly import FrameAssembler, ReadingAges
from mmt.devices.streaming.lanes import Lane, PolledLane
from mmt.devices.streaming.polling import POLLS_HZ
from mmt.devices.streaming.vibration_lane import VibrationLane

DTYPE = np.dtype([("sequence", "u4"), ("time_ns", "i8"), ("force_n", "f8", (3,))])
TRANSPORT_NS = 20_000


def merged(sensor, seconds, *, probes=True, needed_ns=None):
    """Run ticks with some lateness, and probes; return the frames and their ticks' times."""
    chance = random.Random(7)
    lane = Lane(sensor.latency_ns)
    merger = FrameAssembler({"force_n": lane}, DTYPE, MS, needed_ns)
    looks = [(START_NS + k * 100_000, False) for k in range(600)]
    looks += [
        (START_NS + k * MS + round(chance.expovariate(1 / 50_000)), True)
        for k in range(60, round(seconds * 1000))
    ]
    if probes:
        looks += [
            (START_NS + round((k / POLLS_HZ + 0.618034 * k % 1 / 1000) * 1e9), False)
            for k in range(6, round(seconds * POLLS_HZ))
        ]
    blocks, ticks = [], []
    for now_ns, is_tick in sorted(looks):
        lane.add(sensor.arrived(now_ns), now_ns)
        if is_tick:
            merger.tick(1, now_ns)
            blocks.append(merger.frames())
            ticks += [now_ns] * len(blocks[-1])
    return np.concatenate(blocks), np.array(ticks), merger, lane


def seen_hold_back_ns(sensor, looks=600):
    """Look at a sensor ten times in a millisecond; return how long its frames are held back."""
    lane = Lane(sensor.latency_ns)
    ages = ReadingAges([lane])
    for k in range(looks):
        now_ns = START_NS + k * MS // 10
        lane.add(sensor.arrived(now_ns), now_ns)
        ages.record(now_ns)
    return ages.hold_back_ns()


def time_errors_us(frames):
    """How much later than it says a frame was measured; the values are true times in ms."""
    return frames["force_n"][:, 0] * 1e3 - (frames["time_ns"] - START_NS) / 1e3


@pytest.mark.parametrize("drift", [-100e-6, 0.0, 30e-6, 100e-6])
@pytest.mark.parametrize("rate_hz", [800, 1000, 2000, 7000])
def test_a_merged_frame_is_of_the_time_it_says(rate_hz, drift):
    frames, ticks, merger, lane = merged(
        SyntheticSensor(rate_hz, drift, transport_ns=TRANSPORT_NS), 12.0
    )
    errors_us = time_errors_us(frames) + TRANSPORT_NS / 1e3  # which nobody can know
    assert np.std(errors_us) < 40
    assert np.percentile(np.abs(errors_us), 99) < 100
    added_ms = (ticks - frames["time_ns"]) / 1e6 - lane.latency_ns / 1e6
    assert np.percentile(added_ms, 99) < 2.0
    assert merger.left_out < 70  # those before the sensor's first reading
    assert np.diff(frames["sequence"]).max() == 1
    assert lane.clock.drift == pytest.approx(drift, abs=15e-6)
    assert lane.clock.jumps == 0


@pytest.mark.parametrize("rate_hz", [800, 1000, 2000, 7000])
@pytest.mark.parametrize("under_way_ns", [0, 300_000])
def test_frames_are_held_back_by_what_the_readings_show(rate_hz, under_way_ns):
    """A period, what a reading is under way beyond the quickest, and the sensor's latency."""
    sensor = SyntheticSensor(rate_hz, latency_ns=400_000, transport_ns=under_way_ns)
    held_ns = seen_hold_back_ns(sensor)
    beyond_ms = (held_ns - 400_000) / MS - 1e3 / rate_hz
    assert 0.0 < beyond_ms < 0.4


def test_bundles_are_waited_for():
    lane = Lane()
    ages = ReadingAges([lane])
    for k in range(1000):
        now_ns = START_NS + k * MS // 10
        if k % 8 == 0:  # all that was measured in the last 0.8 ms
            lane.add(
                [SensorReading((k - 8 + j) * MS // 10, (0.0, 0.0, 0.0)) for j in range(1, 9)],
                now_ns,
            )
        ages.record(now_ns)
    held_ns = ages.hold_back_ns()
    assert 0.7 * MS <= held_ns <= 0.95 * MS


def test_few_looks_tell_nothing_of_how_long_to_hold_back():
    assert seen_hold_back_ns(SyntheticSensor(1000), looks=10) is None


def test_a_host_that_was_held_up_holds_no_frames_back():
    """Two of five blocks in which nothing came for as long as nobody looked."""
    lane = Lane()
    ages = ReadingAges([lane])
    for k in range(1000):
        now_ns = START_NS + k * MS // 10
        if not 150 < k < 250:
            lane.add([SensorReading(k * MS // 10, (0.0, 0.0, 0.0))], now_ns)
        ages.record(now_ns)
    held_ns = ages.hold_back_ns()
    assert held_ns < 0.25 * MS


@pytest.mark.parametrize("needed_ns", [-(10**15), 0, 10**15])
def test_whatever_was_seen_frames_are_formed_within_bounds(needed_ns):
    """A clock that was set back in the meantime makes nonsense of the ages."""
    sensor = SyntheticSensor(2000, latency_ns=100_000)
    lane = Lane(sensor.latency_ns)
    lane.add(sensor.arrived(START_NS + 100 * MS), START_NS + 100 * MS)
    merger = FrameAssembler({"force_n": lane}, DTYPE, MS, needed_ns)
    merger.tick(1, START_NS + 101 * MS)
    assert 600_000 <= merger.hold_back_ns <= 1_350_000


def test_a_quick_sensors_frames_come_sooner_where_that_was_seen():
    added_ms = []
    for needed_ns in (None, seen_hold_back_ns(SyntheticSensor(2000, 30e-6))):
        frames, ticks, _, lane = merged(SyntheticSensor(2000, 30e-6), 5.0, needed_ns=needed_ns)
        added_ms.append(np.percentile(ticks - frames["time_ns"], 99) / 1e6 - lane.latency_ns / 1e6)
        assert np.diff(frames["sequence"]).max() == 1
    assert added_ms[1] < added_ms[0] - 0.3


def test_without_probes_a_sensor_in_step_with_the_ticks_is_seen_less_well():
    """The reason for the probes: ticks alone sample the arrivals at one point of the period."""
    without, *_ = merged(SyntheticSensor(1000, 100e-6), 12.0, probes=False)
    with_probes, *_ = merged(SyntheticSensor(1000, 100e-6), 12.0)
    assert np.ptp(time_errors_us(without)) > 2 * np.ptp(time_errors_us(with_probes))


def test_the_values_are_those_of_a_straight_line_between_readings():
    lane = Lane(latency_ns=300_000)
    lane.add([SensorReading(0, (0.0, 10.0, -1.0))], START_NS)
    lane.add([SensorReading(MS, (1.0, 20.0, -1.0))], START_NS + MS)
    assert lane.at(START_NS) == pytest.approx((0.3, 13.0, -1.0))
    assert lane.at(START_NS + 700_000) == pytest.approx((1.0, 20.0, -1.0))


def test_all_lanes_of_a_frame_are_of_one_instant_whatever_their_latency():
    early, late = Lane(100_000), Lane(900_000)
    merger = FrameAssembler(
        {"force_n": early, "acceleration_m_s2": late},
        np.dtype([*DTYPE.descr, ("acceleration_m_s2", "f8", (3,))]),
        MS,
    )
    rows = []
    for k in range(20):
        now_ns = START_NS + k * MS
        for lane in (early, late):  # measured a latency before the stamp, which is now
            truth = (now_ns - lane.latency_ns - START_NS) / MS
            lane.add([SensorReading(k * MS, (truth, 0.0, 0.0))], now_ns)
        merger.tick(1, now_ns)
        rows.append(merger.frames())
    frames = np.concatenate(rows)
    assert len(frames) > 15
    truth_ms = (frames["time_ns"] - START_NS) / MS
    assert frames["force_n"][:, 0] == pytest.approx(truth_ms)
    assert frames["acceleration_m_s2"][:, 0] == pytest.approx(truth_ms)


def test_a_lost_record_leaves_a_number_out_and_invents_nothing():
    lane = Lane()
    merger = FrameAssembler({"force_n": lane}, DTYPE, MS)
    frames = []
    for k in range(30):
        now_ns = START_NS + k * MS
        if k not in {10, 11, 12}:
            lane.add([SensorReading(k * MS + 400_000, (float(k), 0.0, 0.0))], now_ns)
        merger.tick(1, now_ns)
        frames.append(merger.frames())
    numbers = np.concatenate(frames)["sequence"].tolist()
    missing = sorted(set(range(numbers[0], numbers[-1])) - set(numbers))
    assert len(missing) == 4  # four steps from the last reading before to the first one after
    assert missing == list(range(missing[0], missing[0] + 4))


@pytest.mark.parametrize("lost", [1, 3, 20, 400])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e39])
@pytest.mark.parametrize("lane", [PolledLane, Lane, VibrationLane])
def test_a_reading_that_is_no_number_is_left_out_and_holds_up_no_frame(lane, value, lost):
    lane, told = lane(), []
    lane.on_invalid = lambda: told.append(None)
    merger = FrameAssembler({"force_n": lane}, frame_dtype(["force"]), MS)
    blocks, waiting = [], []
    for tick in range(500):
        now_ns = START_NS + tick * MS
        reading = (value if 60 <= tick < 60 + lost else 1.0, 0.0, 0.0)
        if isinstance(lane, PolledLane):
            lane.record(reading, now_ns)
        else:
            lane.add([SensorReading(now_ns, reading)], now_ns)
        merger.tick(1, now_ns)
        blocks.append(merger.frames())
        waiting.append(merger.lacking)
    frames = np.concatenate(blocks)
    assert np.allclose(frames["force_n"], [1.0, 0.0, 0.0])
    assert lost - 5 <= merger.left_out <= lost + 3
    assert merger.left_out + len(frames) >= 498
    assert not any(waiting[60:])
    assert lane.invalid == len(told) == lost


def test_a_late_reading_makes_its_frame_late_and_not_wrong():
    lane = Lane()
    merger = FrameAssembler({"force_n": lane}, DTYPE, MS)
    counts, frames = [], []
    for k in range(20):
        now_ns = START_NS + k * MS
        come = range(k, k + 1) if k < 10 else range(10, 15) if k == 14 else range(0)
        come = range(k, k + 1) if k > 14 else come
        lane.add([SensorReading(j * MS, (float(j), 0.0, 0.0)) for j in come], now_ns)
        merger.tick(1, now_ns)
        frames.append(merger.frames())
        counts.append(len(frames[-1]))
    assert max(counts) >= 3
    together = np.concatenate(frames)
    assert np.diff(together["sequence"]).tolist() == [1] * (len(together) - 1)
    assert np.diff(together["force_n"][:, 0]) == pytest.approx(1.0)


def test_ticks_that_were_missed_are_formed_from_what_was_measured_then():
    lane, robot = Lane(), PolledLane()
    merger = FrameAssembler(
        {"position_mm": robot, "force_n": lane},
        np.dtype([*DTYPE.descr[:2], ("position_mm", "f8", (3,)), DTYPE.descr[2]]),
        MS,
    )
    frames = []
    for k in range(30):
        now_ns = START_NS + k * MS
        lane.add([SensorReading(k * MS, (float(k), 0.0, 0.0))], now_ns)
        if k in {10, 11}:
            continue
        robot.record((float(k), 0.0, 0.0), now_ns)
        merger.tick(3 if k == 12 else 1, now_ns)
        frames.append(merger.frames())
    together = np.concatenate(frames)
    assert np.diff(together["sequence"]).tolist() == [1] * (len(together) - 1)
    assert together["position_mm"][:, 0] == pytest.approx(together["force_n"][:, 0])


def test_readings_of_a_clock_that_was_set_back_begin_anew():
    lane = Lane()
    lane.add([SensorReading(10 * MS, (1.0, 1.0, 1.0))], START_NS)
    lane.add([SensorReading(0, (2.0, 2.0, 2.0))], START_NS + MS)
    assert lane.at(START_NS + MS) == (2.0, 2.0, 2.0)


def test_a_poor_crystal_is_followed():
    """A ceramic resonator is half a percent off."""
    frames, _, _, lane = merged(SyntheticSensor(2000, 5e-3), 8.0)
    assert lane.clock.drift == pytest.approx(5e-3, abs=5e-5)
    errors_us = time_errors_us(frames)[4000:]
    assert np.ptp(errors_us) < 300


def test_reading_and_merging_three_sensors_takes_a_small_part_of_a_core():
    """Prints the ratio with ``pytest -s``; the bound is that of the product."""
    sensors = [SyntheticSensor(rate, 50e-6, seed=rate) for rate in (1000, 7000)]
    ticks = 3000
    come = [[sensor.arrived(START_NS + k * MS) for k in range(ticks)] for sensor in sensors]
    lanes = [Lane(sensor.latency_ns) for sensor in sensors]
    robot = PolledLane()
    merger = FrameAssembler(
        {"position_mm": robot, "force_n": lanes[0], "acceleration_m_s2": lanes[1]},
        frame_dtype(),
        MS,
    )
    begun = time.thread_time()
    count = 0
    for k in range(ticks):
        now_ns = START_NS + k * MS
        robot.record((1.0, 2.0, 3.0), now_ns)
        for lane, readings in zip(lanes, come, strict=True):
            lane.add(readings[k], now_ns)
        merger.tick(1, now_ns)
        count += len(merger.frames())
    share = (time.thread_time() - begun) / (ticks / 1000)
    print(f"merging 1 kHz and 7 kHz with a robot at 1 kHz: {100 * share:.1f} % of a core")
    assert count > ticks - 20
    assert share < 0.25


def test_after_seven_weeks_the_numbers_begin_at_nought_again():
    lane = Lane(latency_ns=0)
    merger = FrameAssembler({"force_n": lane}, DTYPE, MS)
    merger.tick(2**32 - 2, START_NS)
    merger.give_up()
    found = []
    for tick in range(12):
        lane.add([SensorReading(tick * MS, (0.0, 0.0, 0.0))], START_NS + tick * MS)
        merger.tick(1, START_NS + (tick + 1) * MS)
        found += merger.frames()["sequence"].tolist()
    first = found[0]
    assert first in (2**32 - 2, 2**32 - 1)
    assert found == [(first + step) % 2**32 for step in range(len(found))]
    assert found[-1] > 5
