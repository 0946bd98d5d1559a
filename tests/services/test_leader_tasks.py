"""The leader's tasks one by one: numbering, modelling, force, vibration, motion."""

import asyncio
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from service_runs import PERIOD_NS, made_frames

from mmt.arrays import RecordArray
from mmt.devices.protocols import InterfaceState, Vector
from mmt.leader import modelling
from mmt.leader.feedback import StreamedForce
from mmt.leader.frame_queue import FrameQueue
from mmt.leader.modelling import ModellingTask
from mmt.leader.numbering import SessionNumbering
from mmt.leader.playout import PlayoutBuffer
from mmt.leader.stream import StreamedMotion, StreamedVibration
from mmt.texture.modelling import ModelUpdate
from mmt.texture.settings import ModellingSettings, VibrationAxis

SECOND = 1_000_000_000

# --- numbering


def test_the_frames_of_one_follower_pass_as_they_are() -> None:
    numbering = SessionNumbering(PERIOD_NS)
    for first in (7, 10, 40):  # with a gap
        frames = made_frames(first, 3)
        taken, left_out = numbering.take(frames, first)
        assert taken is frames
        assert left_out == 0
    assert numbering.frames == 43 - 7


def test_a_follower_that_takes_its_link_up_again_goes_on_counting() -> None:
    numbering = SessionNumbering(PERIOD_NS)
    numbering.take(made_frames(0, 100), 1)
    numbering.reconnect()
    again = made_frames(300, 5)
    assert numbering.take(again, 2) == (again, 0)
    assert numbering.frames == 305


def test_a_follower_that_is_started_anew_is_put_behind_the_silence() -> None:
    numbering = SessionNumbering(PERIOD_NS)
    numbering.take(made_frames(0, 100), 5 * SECOND)
    numbering.reconnect()
    again = made_frames(0, 10)
    again["time_ns"] += 350 * PERIOD_NS  # the same machine's clock
    taken, left_out = numbering.take(again, 5 * SECOND + 250 * PERIOD_NS)
    assert left_out == 250
    assert taken["sequence"].tolist() == list(range(350, 360))
    np.testing.assert_array_equal(taken["time_ns"], again["time_ns"])
    np.testing.assert_array_equal(taken["force_n"], again["force_n"])
    assert again["sequence"][0] == 0, "the follower's own block must not change"
    following, left_out = numbering.take(made_frames(10, 2), 5 * SECOND + 260 * PERIOD_NS)
    assert left_out == 0
    assert following["sequence"].tolist() == [360, 361]


def test_a_follower_that_counts_from_far_ahead_is_put_behind_the_silence_too() -> None:
    numbering = SessionNumbering(PERIOD_NS)
    numbering.take(made_frames(0, 100), 5 * SECOND)
    numbering.reconnect()
    taken, left_out = numbering.take(made_frames(2**31 - 20, 10), 5 * SECOND + 250 * PERIOD_NS)
    assert left_out == 250
    assert taken["sequence"].tolist() == list(range(350, 360))
    assert numbering.frames == 360


def test_another_process_is_told_by_its_name_whatever_it_counts() -> None:
    numbering = SessionNumbering(PERIOD_NS)
    numbering.reconnect("first")
    numbering.take(made_frames(0, 100), SECOND)
    numbering.reconnect("first")
    assert numbering.take(made_frames(200, 100), 2 * SECOND)[1] == 0
    numbering.reconnect("second")
    assert numbering.anew
    taken, left_out = numbering.take(made_frames(400, 10), 2 * SECOND + 50 * PERIOD_NS)
    assert left_out == 50
    assert taken["sequence"][0] == 350
    assert numbering.renumber(made_frames(410, 1))["sequence"][0] == 360
    assert numbering.shift == -50


def test_another_clock_is_put_right_but_echoed_as_it_is() -> None:
    numbering = SessionNumbering(PERIOD_NS)
    first = made_frames(0, 100)
    first["time_ns"] += 90_000 * SECOND
    numbering.take(first, SECOND)
    numbering.reconnect()
    again = made_frames(0, 10)
    taken, left_out = numbering.take(again, SECOND + 20 * PERIOD_NS)
    assert left_out == 20
    assert taken["time_ns"][0] - first["time_ns"][-1] == 21 * PERIOD_NS
    assert (np.diff(taken["time_ns"]) == PERIOD_NS).all()
    assert numbering.follower_time_ns == again["time_ns"][-1]


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.booleans(), st.integers(0, 50), st.integers(1, 5), st.integers(0, 10**10)),
        min_size=1,
        max_size=20,
    )
)
def test_numbers_always_rise_whatever_connects(
    arrivals: list[tuple[bool, int, int, int]],
) -> None:
    numbering = SessionNumbering(PERIOD_NS)
    sequences: list[int] = []
    raw, now_ns = 0, 0
    for anew, skipped, count, silence_ns in arrivals:
        now_ns += silence_ns
        if anew:
            numbering.reconnect()
            raw = 0
        raw += skipped
        taken, _ = numbering.take(made_frames(raw, count), now_ns)
        raw += count
        sequences += taken["sequence"].tolist()
    assert (np.diff(sequences) > 0).all()
    assert numbering.frames == sequences[-1] + 1 - sequences[0]


# --- modelling


class SlowModeller:
    """Notes what it is given; waits for leave to end an update."""

    def __init__(self) -> None:
        self.updates: list[RecordArray] = []
        self.started = threading.Event()
        self.leave = threading.Event()
        self.leave.set()
        self.stops = False

    def stages(self, frames: RecordArray) -> Iterator[ModelUpdate | None]:
        self.updates.append(frames)
        self.started.set()
        yield None
        assert self.leave.wait(10)
        yield ModelUpdate(
            time_s=float(frames["sequence"][-1]),
            samples=len(self.updates),
            added=0,
            removed=0,
            distance=9.0,
            order=None,
            started=False,
            stopped=self.stops,
            model=None,
            durations_s={},
        )


class Modelled:
    """A modelling task with modellers that a test controls."""

    def __init__(self, period_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
        self._modellers: list[SlowModeller] = []
        monkeypatch.setattr(modelling, "OnlineModeller", self._make)
        self.updates: list[ModelUpdate] = []
        self.seconds: list[float] = []
        self.task = ModellingTask(ModellingSettings(), period_s, self._note)

    @property
    def modeller(self) -> SlowModeller:
        """The newest one."""
        return self._modellers[-1]

    def _make(self, _: ModellingSettings) -> SlowModeller:
        self._modellers.append(SlowModeller())
        return self.modeller

    def _note(self, update: ModelUpdate, seconds: float) -> None:
        self.updates.append(update)
        self.seconds.append(seconds)

    async def settle(self, updates: int) -> None:
        async with asyncio.timeout(10):
            while len(self.updates) < updates:
                await asyncio.sleep(0.001)


@asynccontextmanager
async def modelled(
    monkeypatch: pytest.MonkeyPatch, period_s: float = 0.1
) -> AsyncIterator[Modelled]:
    made = Modelled(period_s, monkeypatch)
    running = asyncio.create_task(made.task.run())
    try:
        yield made
    finally:
        made.modeller.leave.set()
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running


async def test_an_update_comes_once_a_period_with_every_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with modelled(monkeypatch) as made:
        for first in range(0, 300, 5):
            made.task.take(made_frames(first, 5))
            if first % 100 == 95:
                await made.settle(first // 100 + 1)
        sizes = [len(update) for update in made.modeller.updates]
        assert sizes == [100, 100, 100]
        given_on = np.concatenate(made.modeller.updates)["sequence"]
        np.testing.assert_array_equal(given_on, np.arange(300))
        assert made.task.dropped_frames == 0
        assert all(seconds >= 0 for seconds in made.seconds)


async def test_a_period_is_counted_over_frames_that_are_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with modelled(monkeypatch) as made:
        made.task.take(made_frames(0, 2))
        made.task.take(made_frames(99, 1))
        await made.settle(1)
        assert made.modeller.updates[0]["sequence"].tolist() == [0, 1, 99]


async def test_what_waits_is_bounded_and_the_oldest_is_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with modelled(monkeypatch) as made:
        made.modeller.leave.clear()
        made.task.take(made_frames(0, 100))
        assert await asyncio.to_thread(made.modeller.started.wait, 10)
        assert made.task.working
        for first in range(100, 12_100, 100):
            made.task.take(made_frames(first, 100))
        assert made.task.dropped_frames == 2000
        made.modeller.leave.set()
        await made.settle(2)
        assert not made.task.working
        np.testing.assert_array_equal(made.modeller.updates[1]["sequence"], np.arange(2100, 12_100))


async def test_of_a_block_longer_than_the_queue_the_newest_frames_are_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with modelled(monkeypatch) as made:
        made.task.take(made_frames(0, 10_001))
        await made.settle(1)
        np.testing.assert_array_equal(made.modeller.updates[0]["sequence"], np.arange(1, 10_001))
        assert made.task.dropped_frames == 1


async def test_a_reset_throws_away_what_is_under_way_and_what_waits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with modelled(monkeypatch) as made:
        old = made.modeller
        old.leave.clear()
        made.task.take(made_frames(0, 100))
        assert await asyncio.to_thread(old.started.wait, 10)
        made.task.take(made_frames(100, 100))
        made.task.reset()
        old.leave.set()
        made.task.take(made_frames(200, 100))
        await made.settle(1)
        assert made.modeller is not old
        assert len(old.updates) == 1
        assert made.updates[0].time_s == 299.0
        np.testing.assert_array_equal(made.modeller.updates[0]["sequence"], np.arange(200, 300))


async def test_modelling_pauses_when_it_is_complete_until_it_is_reset(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with modelled(monkeypatch) as made:
        made.modeller.stops = True
        made.task.take(made_frames(0, 100))
        await made.settle(1)
        assert made.task.finished
        made.task.take(made_frames(100, 100))
        await asyncio.sleep(0.02)
        assert len(made.modeller.updates) == 1
        made.task.reset()
        made.task.take(made_frames(200, 100))
        await made.settle(2)
        assert not made.task.finished


async def test_updates_wait_for_frames_that_may_still_come_and_are_cut_by_numbers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    missing: list[int] = [40]
    async with modelled(monkeypatch) as made:
        made.task.first_missing = lambda: missing[0] if missing else None
        made.task.take(made_frames(0, 40))
        made.task.take(made_frames(60, 240))
        await asyncio.sleep(0.02)
        assert made.updates == []
        made.task.fill(made_frames(50, 10))
        made.task.fill(made_frames(40, 10))
        missing.clear()
        made.task.look_again()
        await made.settle(3)
        for number, update in enumerate(made.modeller.updates):
            np.testing.assert_array_equal(
                update["sequence"], np.arange(100 * number, 100 * number + 100)
            )
        assert made.task.late_frames == 0


async def test_frames_that_come_after_their_update_are_left_out_and_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with modelled(monkeypatch) as made:
        made.task.take(made_frames(0, 40))
        made.task.take(made_frames(60, 40))
        await made.settle(1)
        made.task.fill(made_frames(40, 20))
        made.task.take(made_frames(100, 100))
        await made.settle(2)
        assert made.task.late_frames == 20
        np.testing.assert_array_equal(made.modeller.updates[1]["sequence"], np.arange(100, 200))


async def test_a_gap_that_never_closes_cannot_hold_the_modelling_up_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with modelled(monkeypatch) as made:
        made.task.first_missing = lambda: 0
        for first in range(1, 9001, 100):
            made.task.take(made_frames(first, 100))
            await asyncio.sleep(0)
        await made.settle(1)
        assert made.task.dropped_frames == 0


async def test_what_is_complete_at_the_end_is_still_modelled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with modelled(monkeypatch) as made:
        made.task.take(made_frames(0, 350))
        await made.task.finish(10.0)
        assert len(made.updates) == 3
        made.modeller.leave.clear()
        made.task.take(made_frames(350, 100))
        await made.task.finish(0.05)
        assert len(made.updates) == 3


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(0, 60), unique=True, max_size=60), st.integers(1, 20), st.data())
def test_however_frames_come_the_queue_gives_them_out_in_order_and_once(
    numbers: list[int], period: int, data: st.DataObject
) -> None:
    in_time = data.draw(st.sets(st.sampled_from(numbers))) if numbers else set()
    queue = FrameQueue(100, least_drop=1)
    for number in sorted(in_time):
        assert queue.put(made_frames(number, 1)) == 0
    for number in numbers:
        if number not in in_time:
            assert queue.insert(made_frames(number, 1)) == 0
    given_out: list[int] = []
    while (frames := queue.take_period(period, None)) is not None:
        taken = frames["sequence"].astype(np.int64)
        assert taken[-1] - taken[0] >= period - 1
        assert len(taken) == 1 or taken[-2] - taken[0] < period - 1
        given_out += taken.tolist()
    given_out += queue.take_all()["sequence"].tolist() if numbers else []
    assert given_out == sorted(numbers)
    assert len(queue) == 0


async def test_an_update_that_fails_comes_out_of_the_task(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = Modelled(0.1, monkeypatch)
    monkeypatch.setattr(made.modeller, "stages", lambda frames: 1 / 0)
    made.task.take(made_frames(0, 100))
    with pytest.raises(ZeroDivisionError):
        await asyncio.wait_for(made.task.run(), 10)


# --- force


class Handle:
    """An interface that notes what it displays."""

    def __init__(self) -> None:
        self.forces: list[Vector] = []

    def connect(self) -> None: ...

    def calibrate(self) -> None: ...

    def close(self) -> None: ...

    def read(self, elapsed_ticks: int) -> InterfaceState:
        raise NotImplementedError

    def write(self, force_n: Vector) -> None:
        self.forces.append(force_n)


def forced(*force_n: float) -> RecordArray:
    frames = made_frames(0, 2)
    frames["force_n"][-1] = force_n
    return frames


def test_the_newest_force_is_displayed_within_the_limit_in_its_direction() -> None:
    handle = Handle()
    force = StreamedForce(handle, limit_n=3.0)
    force.tick(1, None)
    force.take(forced(0.0, 0.0, 2.5))
    force.tick(1, None)
    force.take(forced(30.0, 0.0, 40.0))
    force.tick(1, None)
    assert handle.forces[0] == (0.0, 0.0, 0.0)
    assert handle.forces[1] == (0.0, 0.0, 2.5)
    assert handle.forces[2] == pytest.approx((1.8, 0.0, 2.4))


def test_the_force_fades_to_zero_in_silence_and_comes_back() -> None:
    handle = Handle()
    force = StreamedForce(handle, limit_n=3.0, silence_ticks=50)
    force.take(forced(0.0, 0.0, 2.0))
    for _ in range(120):
        force.tick(1, None)
    normal = [z for _, _, z in handle.forces]
    assert normal[:50] == [2.0] * 50
    assert (np.diff(normal[49:100]) < 0).all()
    assert normal[99:] == [0.0] * 21
    for _ in range(60):
        force.take(forced(0.0, 0.0, 2.0))
        force.tick(1, None)
    back = [z for _, _, z in handle.forces[120:]]
    assert back[0] == pytest.approx(0.04)
    assert (np.diff(back[:50]) > 0).all()
    assert back[49:] == [2.0] * 11


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 200), st.floats(0.0, 3.0)), min_size=1, max_size=12))
def test_a_force_that_comes_and_goes_never_steps(stretches: list[tuple[int, float]]) -> None:
    handle = Handle()
    force = StreamedForce(handle, limit_n=3.0)
    for _ in range(60):  # as before a session: nothing has been heard yet
        force.tick(1, None)
    for silence_ticks, force_n in stretches:
        for _ in range(50 + silence_ticks):
            force.tick(1, None)
        for _ in range(1 + silence_ticks % 60):
            force.take(forced(0.0, 0.0, force_n))
            force.tick(1, None)
    normal = np.array([z for _, _, z in handle.forces])
    assert np.abs(np.diff(normal)).max() <= 3.0 / 50 + 1e-12


def test_missed_ticks_count_for_the_silence() -> None:
    handle = Handle()
    force = StreamedForce(handle, limit_n=3.0, silence_ticks=50)
    force.take(forced(0.0, 0.0, 2.0))
    force.tick(75, None)
    assert handle.forces == [pytest.approx((0.0, 0.0, 1.0))]


# --- vibration and motion


def vibrating(count: int) -> RecordArray:
    """A vibration of 100 Hz on gravity, along z; a slower one along x."""
    frames = made_frames(0, count, ("acceleration",))
    phase = 2 * np.pi * 0.1 * np.arange(count)
    frames["acceleration_m_s2"] = 0.0
    frames["acceleration_m_s2"][:, 2] = 9.81 + np.sin(phase)
    frames["acceleration_m_s2"][:, 0] = 5.0 * np.sin(phase / 2)
    return frames


def played(stream: StreamedVibration, buffer: PlayoutBuffer, frames: RecordArray) -> np.ndarray:
    output = []
    for frame in frames:
        now_ns = int(frame["time_ns"])
        stream.take(np.atleast_1d(frame), now_ns)
        output.append(buffer.pull(now_ns))
    return np.array(output)


@pytest.mark.parametrize(("axis", "peak"), [("z", 1.0), ("x", 5.0), ("dft321", 1.0)])
def test_the_streamed_vibration_is_the_acceleration_without_gravity(
    axis: VibrationAxis, peak: float
) -> None:
    buffer = PlayoutBuffer(delay_ms=2.0)
    stream = StreamedVibration(buffer, axis, "z", 1000.0)
    output = played(stream, buffer, vibrating(1000))
    assert np.abs(output[:10]).max() < 1.2 * peak, "gravity must make no step"
    assert np.abs(output[500:]).max() == pytest.approx(peak, rel=0.05)
    assert abs(output[500:].mean()) < 0.05 * peak


def test_a_gap_in_the_stream_makes_no_click() -> None:
    buffer = PlayoutBuffer(delay_ms=2.0)
    stream = StreamedVibration(buffer, "z", "z", 1000.0)
    frames = vibrating(600)
    frames["acceleration_m_s2"][300:, 2] += 40.0  # unseen: the gap hides the step
    output = played(stream, buffer, frames[np.r_[0:250, 300:600]])
    assert np.abs(output).max() < 2.0


def moving(speed_mm_s: float, force_n: float, count: int) -> RecordArray:
    frames = made_frames(0, count)
    time_s = np.arange(count) / 1000
    frames["position_mm"] = 0.0
    frames["position_mm"][:, 0] = 0.6 * speed_mm_s * time_s
    frames["position_mm"][:, 1] = 0.8 * speed_mm_s * time_s
    frames["position_mm"][:, 2] = 50 * np.sin(time_s * 20)
    frames["force_n"] = (7.0, 7.0, force_n)
    return frames


@pytest.mark.parametrize("size", [1, 7, 400])
def test_speed_is_tangential_and_force_is_normal(size: int) -> None:
    motion = StreamedMotion("z", 1000.0)
    frames = moving(120.0, 1.5, 400)
    for first in range(0, 400, size):
        motion.take(frames[first : first + size])
    assert motion.speed_mm_s == pytest.approx(120.0, rel=1e-3)
    assert motion.force_n == pytest.approx(1.5, rel=1e-3)


def test_pulling_is_no_normal_force_and_rest_is_zero() -> None:
    motion = StreamedMotion("z", 1000.0)
    motion.take(moving(50.0, -2.0, 300))
    assert motion.force_n == 0.0
    assert motion.speed_mm_s > 49.0
    motion.rest()
    assert (motion.speed_mm_s, motion.force_n) == (0.0, 0.0)


def test_a_gap_makes_no_jump_of_speed() -> None:
    motion = StreamedMotion("z", 1000.0)
    frames = moving(100.0, 1.0, 2000)
    motion.take(frames[:500])
    speeds = []
    for frame in frames[1500:]:
        motion.take(np.atleast_1d(frame))
        speeds.append(motion.speed_mm_s)
    assert max(speeds) < 110.0
    assert speeds[-1] == pytest.approx(100.0, rel=1e-3)
