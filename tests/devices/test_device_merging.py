"""Merging sensors on clocks of their own: time errors, latencies, gaps."""

import math
import random

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


def merged(sensor, seconds):
    """Run ticks with some lateness, and probes; return the frames and their ticks' times."""
    chance = random.Random(7)
    lane = Lane(sensor.latency_ns)
    merger = FrameAssembler({"force_n": lane}, DTYPE, MS)
    looks = [(START_NS + k * 100_000, False) for k in range(600)]
    looks += [
        (START_NS + k * MS + round(chance.expovariate(1 / 50_000)), True)
        for k in range(60, round(seconds * 1000))
    ]
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
    return np.concatenate(blocks), np.array(ticks), lane


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
    frames, ticks, lane = merged(SyntheticSensor(rate_hz, drift, transport_ns=TRANSPORT_NS), 12.0)
    errors_us = time_errors_us(frames) + TRANSPORT_NS / 1e3  # which nobody can know
    assert np.std(errors_us) < 40
    assert np.percentile(np.abs(errors_us), 99) < 100
    added_ms = (ticks - frames["time_ns"]) / 1e6 - lane.latency_ns / 1e6
    assert np.percentile(added_ms, 99) < 2.0
    assert lane.missed_frames == 0  # those before the sensor's first reading do not count
    assert np.diff(frames["sequence"]).max() == 1
    assert lane.clock.drift == pytest.approx(drift, abs=15e-6)
    assert lane.clock.jumps == 0


@pytest.mark.parametrize("rate_hz", [800, 1000, 2000, 7000])
@pytest.mark.parametrize("under_way_ns", [0, 300_000])
def test_frames_are_held_back_by_what_the_readings_show(rate_hz, under_way_ns):
    """A period, what a reading is under way beyond the quickest, and the sensor's latency."""
    sensor = SyntheticSensor(rate_hz, latency_ns=400_000, transport_ns=under_way_ns)
    held_ns = seen_hold_back_ns(sensor)
    assert seen_hold_back_ns(sensor, looks=10) is None  # too few tell nothing
    beyond_ms = (held_ns - 400_000) / MS - 1e3 / rate_hz
    assert 0.0 < beyond_ms < 0.4


@pytest.mark.parametrize(
    ("comes", "bundle", "least_ms", "most_ms"),
    [
        (lambda k: k % 8 == 0, 8, 0.7, 0.95),
        # held up in two of five blocks, in which nothing came for as long as nobody looked
        (lambda k: not 150 < k < 250, 1, 0.0, 0.25),
    ],
    ids=["bundles", "host held up"],
)
def test_bundles_are_waited_for_and_a_host_that_was_held_up_is_not(
    comes, bundle, least_ms, most_ms
):
    lane = Lane()
    ages = ReadingAges([lane])
    for k in range(1000):
        now_ns = START_NS + k * MS // 10
        if comes(k):  # all that was measured since
            stamps = [(k - bundle + j) * MS // 10 for j in range(1, bundle + 1)]
            lane.add([SensorReading(stamp, (0.0, 0.0, 0.0)) for stamp in stamps], now_ns)
        ages.record(now_ns)
    assert least_ms * MS <= ages.hold_back_ns() <= most_ms * MS


@pytest.mark.parametrize(
    ("needed_ns", "held_ns"), [(-(10**15), 600_000), (0, 600_000), (10**15, 1_350_000)]
)
def test_whatever_was_seen_frames_are_formed_within_bounds(needed_ns, held_ns):
    """A clock that was set back in the meantime makes nonsense of the ages."""
    sensor = SyntheticSensor(2000, latency_ns=100_000)
    lane = Lane(sensor.latency_ns)
    lane.add(sensor.arrived(START_NS + 100 * MS), START_NS + 100 * MS)
    merger = FrameAssembler({"force_n": lane}, DTYPE, MS, needed_ns)
    merger.tick(1, START_NS + 101 * MS)
    assert merger.hold_back_ns == held_ns


def formed(ticks, come):
    """Return the frames of each tick, of a lane whose readings `come` gives for its number."""
    lane, blocks = Lane(), []
    merger = FrameAssembler({"force_n": lane}, DTYPE, MS)
    for k in range(ticks):
        now_ns = START_NS + k * MS
        lane.add(come(k), now_ns)
        merger.tick(1, now_ns)
        blocks.append(merger.frames())
    return blocks


def reading(time_ns, value):
    return SensorReading(round(time_ns), (float(value), 0.0, 0.0))


def test_the_values_are_those_of_a_straight_line_between_readings():
    lane = Lane(latency_ns=300_000)
    lane.add([SensorReading(0, (0.0, 10.0, -1.0))], START_NS)
    lane.add([SensorReading(MS, (1.0, 20.0, -1.0))], START_NS + MS)
    assert lane.at(START_NS) == pytest.approx((0.3, 13.0, -1.0))
    assert lane.at(START_NS + 700_000) == pytest.approx((1.0, 20.0, -1.0))


def test_all_lanes_of_a_frame_are_of_one_instant_whatever_their_latency():
    early, late = Lane(100_000), Lane(900_000)
    lanes = {"force_n": early, "acceleration_m_s2": late}
    merger = FrameAssembler(lanes, frame_dtype(["force", "acceleration"]), MS)
    rows = []
    for k in range(20):
        now_ns = START_NS + k * MS
        for lane in (early, late):  # measured a latency before the stamp, which is now
            lane.add([reading(k * MS, k - lane.latency_ns / MS)], now_ns)
        merger.tick(1, now_ns)
        rows.append(merger.frames())
    frames = np.concatenate(rows)
    assert len(frames) > 15
    truth_ms = (frames["time_ns"] - START_NS) / MS
    assert frames["force_n"][:, 0] == pytest.approx(truth_ms, abs=1e-5)
    assert frames["acceleration_m_s2"][:, 0] == pytest.approx(truth_ms, abs=1e-5)


def test_a_lost_record_leaves_a_number_out_and_invents_nothing():
    lost = {10, 11, 12}
    come = formed(30, lambda k: [reading(k * MS + 400_000, k)] * (k not in lost))
    numbers = np.concatenate(come)["sequence"].tolist()
    missing = sorted(set(range(numbers[0], numbers[-1])) - set(numbers))
    # four steps from the last reading before to the first one after
    assert missing == list(range(missing[0], missing[0] + 4))


@pytest.mark.parametrize("lost", [1, 3, 20, 400])
@pytest.mark.parametrize("value", [math.nan, -math.inf, 1e39])
@pytest.mark.parametrize("lane", [PolledLane, Lane, VibrationLane])
def test_a_reading_that_is_no_number_is_left_out_and_holds_up_no_frame(lane, value, lost):
    lane, told = lane(), []
    lane.on_invalid = lambda: told.append(None)
    merger = FrameAssembler({"force_n": lane}, DTYPE, MS)
    blocks, waiting = [], []
    for tick in range(500):
        now_ns = START_NS + tick * MS
        vector = (value if 60 <= tick < 60 + lost else 1.0, 0.0, 0.0)
        if isinstance(lane, PolledLane):
            lane.record(vector, now_ns)
        else:
            lane.add([SensorReading(now_ns, vector)], now_ns)
        merger.tick(1, now_ns)
        blocks.append(merger.frames())
        waiting.append(merger.lacking)
    frames = np.concatenate(blocks)
    assert np.allclose(frames["force_n"], [1.0, 0.0, 0.0])
    assert lost - 5 <= lane.missed_frames <= lost + 3
    assert lane.missed_frames + len(frames) >= 490
    assert not any(waiting[60:])
    assert lane.invalid == len(told) == lost


def test_a_late_reading_makes_its_frame_late_and_not_wrong():
    def come(k):
        late = range(10, 15) if k == 14 else range(0)
        return [reading(j * MS, j) for j in (late if 10 <= k < 15 else [k])]

    blocks = formed(20, come)
    assert max(map(len, blocks)) >= 3
    frames = np.concatenate(blocks)
    assert np.diff(frames["sequence"]).tolist() == [1] * (len(frames) - 1)
    assert np.diff(frames["force_n"][:, 0]) == pytest.approx(1.0)


@pytest.mark.parametrize("missed", [2, 40])
def test_ticks_that_were_missed_are_formed_from_what_was_measured_then(missed):
    """If the robot was not read for too long, those frames are skipped and counted as its own."""
    lane, robot = Lane(), PolledLane()
    merger = FrameAssembler(
        {"position_mm": robot, "force_n": lane}, frame_dtype(["position", "force"]), MS
    )
    frames = []
    for k in range(30 + missed):
        now_ns = START_NS + k * MS
        lane.add([reading(k * MS, k)], now_ns)
        if 10 <= k < 10 + missed:
            continue
        robot.record((float(k), 0.0, 0.0), now_ns)
        merger.tick(missed + 1 if k == 10 + missed else 1, now_ns)
        frames.append(merger.frames())
    together = np.concatenate(frames)
    skipped = np.diff(together["sequence"].astype(int)) - 1
    assert robot.missed_frames == skipped.sum() == (missed + 1 if missed > 2 else 0)
    assert lane.missed_frames == 0
    assert together["position_mm"][:, 0] == pytest.approx(together["force_n"][:, 0])


def test_readings_of_a_clock_that_was_set_back_begin_anew():
    lane = Lane()
    lane.add([SensorReading(10 * MS, (1.0, 1.0, 1.0))], START_NS)
    lane.add([SensorReading(0, (2.0, 2.0, 2.0))], START_NS + MS)
    assert lane.at(START_NS + MS) == (2.0, 2.0, 2.0)


def test_after_seven_weeks_the_numbers_begin_at_nought_again():
    lane = Lane(latency_ns=0)
    merger = FrameAssembler({"force_n": lane}, DTYPE, MS)
    merger.tick(2**32 - 2, START_NS)
    merger.give_up()
    found = []
    for tick in range(12):
        lane.add([reading(tick * MS, 0.0)], START_NS + tick * MS)
        merger.tick(1, START_NS + (tick + 1) * MS)
        found += merger.frames()["sequence"].tolist()
    assert found[0] in (2**32 - 2, 2**32 - 1)
    assert found == [(found[0] + step) % 2**32 for step in range(len(found))]
    assert found[-1] > 5
