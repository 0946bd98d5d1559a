"""The modelling's tasks: what they give to a modeller, when, and what they drop."""

import asyncio
import threading
from contextlib import asynccontextmanager
from dataclasses import replace

import numpy as np
import pytest
from frame_samples import made_frames
from model_updates import made_update
from modelling_beside import InThread

from mmt.leader.modelling.pipeline import Modelling
from mmt.leader.modelling.process import ModellingProcess
from mmt.leader.modelling.stage import Item, StageTask
from mmt.leader.part import Session
from mmt.scene import Scene
from mmt.scene.files import scene_from_tables
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.modeller_factory import ModellerFactory
from mmt.texture.online import modeller as online_modeller
from mmt.texture.online.updates import ReadyModel, UpdateWork
from mmt.texture.segmentation.segmenter import SampleRange
from mmt.texture.settings import ModellingSettings


class SlowModeller:
    """Notes what it is given; waits for leave to end an update."""

    kept = None

    def __init__(self):
        self.updates = []
        self.started = threading.Event()
        self.leave = threading.Event()
        self.leave.set()
        self.stops = False

    def segment(self, frames):
        self.updates.append(frames)
        self.started.set()
        assert self.leave.wait(10)
        me = self
        yield UpdateWork(me, float(frames["sequence"][-1]), [], [], [], 0.0)

    def fit(self, work): ...

    def build(self, work): ...

    def judge(self, work):
        work.update = made_update(work.time_s, samples=len(self.updates), stopped=self.stops)


class Modelled:
    """The modelling's tasks with modellers that a test controls."""

    def __init__(self, period_s, monkeypatch):
        self._modellers = []
        monkeypatch.setattr(online_modeller, "OnlineModeller", self._make)
        self.updates = []
        self.seconds = []
        self.task = Modelling(Session(Scene()), InThread(ModellingSettings(), period_s))
        self.task.deliver = self._note

    @property
    def modeller(self) -> SlowModeller:
        """The newest one."""
        return self._modellers[-1]

    def _make(self, _):
        self._modellers.append(SlowModeller())
        return self.modeller

    def _note(self, update, seconds):
        self.updates.append(update)
        self.seconds.append(seconds)

    async def settle(self, updates):
        async with asyncio.timeout(10):
            while len(self.updates) < updates:
                await asyncio.sleep(0.001)


@asynccontextmanager
async def running(task):
    await asyncio.to_thread(task.connect)
    tasks = [asyncio.create_task(run, name=name) for name, run in task.tasks().items()]
    try:
        yield
    finally:
        for run in tasks:
            run.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        task.close()


@asynccontextmanager
async def modelled(monkeypatch, period_s=0.1):
    made = Modelled(period_s, monkeypatch)
    async with running(made.task):
        try:
            yield made
        finally:
            made.modeller.leave.set()


async def test_an_update_comes_once_a_period_with_every_frame(monkeypatch):
    async with modelled(monkeypatch) as made:
        for first in range(0, 300, 5):
            made.task.on_frames(made_frames(first, 5))
            if first % 100 == 95:
                await made.settle(first // 100 + 1)
        sizes = [len(update) for update in made.modeller.updates]
        assert sizes == [100, 100, 100]
        given_on = np.concatenate(made.modeller.updates)["sequence"]
        np.testing.assert_array_equal(given_on, np.arange(300))
        assert made.task.segmenting.figures.drops == 0
        assert all(seconds >= 0 for seconds in made.seconds)


async def test_what_waits_is_bounded_and_the_oldest_is_dropped(monkeypatch):
    async with modelled(monkeypatch) as made:
        made.modeller.leave.clear()
        made.task.on_frames(made_frames(0, 100))
        assert await asyncio.to_thread(made.modeller.started.wait, 10)
        assert made.task.working
        for first in range(100, 12_100, 100):
            made.task.on_frames(made_frames(first, 100))
        assert made.task.segmenting.figures.drops == 2000
        made.modeller.leave.set()
        await made.settle(2)
        assert not made.task.working
        np.testing.assert_array_equal(made.modeller.updates[1]["sequence"], np.arange(2100, 12_100))


async def test_a_reset_throws_away_what_is_under_way_and_what_waits_and_ends_a_pause(monkeypatch):
    async with modelled(monkeypatch) as made:
        old = made.modeller
        old.leave.clear()
        made.task.on_frames(made_frames(0, 100))
        assert await asyncio.to_thread(old.started.wait, 10)
        made.task.on_frames(made_frames(100, 100))
        made.task.reset()
        old.leave.set()
        made.task.on_backfill(made_frames(150, 20))  # of the old surface
        made.task.on_frames(made_frames(200, 100))
        await made.settle(1)
        second = made.modeller
        assert second is not old
        assert len(old.updates) == 1
        assert made.updates[0].time_s == 299.0
        np.testing.assert_array_equal(second.updates[0]["sequence"], np.arange(200, 300))
        second.stops = True
        made.task.on_frames(made_frames(300, 100))
        await made.settle(2)
        assert made.task.finished
        made.task.on_frames(made_frames(400, 100))  # of which nothing is modelled
        await asyncio.sleep(0.02)
        assert len(second.updates) == 2
        made.task.reset()
        made.task.on_frames(made_frames(700, 100))  # after a silence
        await made.settle(3)
        assert made.task.since_s == 0.7
        assert not made.task.finished


async def test_updates_wait_for_frames_that_may_still_come_and_leave_out_later_ones(monkeypatch):
    missing = [40]
    async with modelled(monkeypatch) as made:
        made.task.segmenting.first_missing = lambda: missing[0] if missing else None
        made.task.on_frames(made_frames(0, 40))
        made.task.on_frames(made_frames(60, 240))
        await asyncio.sleep(0.02)
        assert made.updates == []
        made.task.on_backfill(made_frames(50, 10))
        missing.clear()
        made.task.on_settled()
        await made.settle(3)
        made.task.on_backfill(made_frames(40, 10))
        assert made.task.segmenting.late_frames == 10
        made.task.on_frames(made_frames(300, 100))
        await made.settle(4)
        expected = [[*range(40), *range(50, 100)], *(range(k, k + 100) for k in (100, 200, 300))]
        for update, sequence in zip(made.modeller.updates, expected, strict=True):
            assert update["sequence"].tolist() == list(sequence)


async def test_a_gap_that_never_closes_cannot_hold_the_modelling_up_for_ever(monkeypatch):
    async with modelled(monkeypatch) as made:
        made.task.segmenting.first_missing = lambda: 0
        for first in range(1, 9001, 100):
            made.task.on_frames(made_frames(first, 100))
            await asyncio.sleep(0)
        await made.settle(1)
        assert made.task.segmenting.figures.drops == 0


async def test_what_is_complete_at_the_end_is_still_modelled(monkeypatch):
    async with modelled(monkeypatch) as made:
        made.task.on_frames(made_frames(0, 350))
        await made.task.finish(10.0)
        assert len(made.updates) == 3
        made.modeller.leave.clear()
        made.task.on_frames(made_frames(350, 100))
        await made.task.finish(0.05)
        assert len(made.updates) == 3


async def test_a_frozen_model_takes_no_frames_until_it_may_grow(monkeypatch):
    async with modelled(monkeypatch) as made:
        made.task.on_frames(made_frames(0, 50))
        made.task.freeze(True)
        made.task.on_frames(made_frames(50, 100))
        made.task.on_backfill(made_frames(150, 100))
        made.task.freeze(False)
        made.task.on_backfill(made_frames(50, 20))
        made.task.on_frames(made_frames(500, 100))
        await made.settle(1)
        np.testing.assert_array_equal(made.modeller.updates[0]["sequence"], np.arange(500, 600))
        made.task.freeze(True)
        made.task.reset()
        assert not made.task.frozen


TEXTURES = {
    "demo": {},
    "fixed order": {"order": 10},
    "published": {"method": "published"},
    "surfaces": {"surfaces": {}},
    "touch-downs": {},
}


def described(update):
    """Everything that an update says but the time it took; the model by its file."""
    said = vars(replace(update, durations_s={}, source=ReadyModel(), left=())).values()
    model = None if update.model is None else update.model.to_bytes()
    return (*said, model, tuple(described(state) for state in update.left))


@pytest.mark.parametrize("name", list(TEXTURES))
async def test_the_tasks_make_the_model_of_an_offline_pass_to_the_bit(name):
    tables = {"link": {}, "simulated": {}, "hand": {}, "texture": TEXTURES[name]}
    touched = name == "touch-downs"
    if touched:
        tables |= {"session": {"acceleration_rate_hz": 5000, "seed": 2}, "hand": {"kind": "taps"}}
    scene = scene_from_tables(tables)
    duration_s = {"touch-downs": 6.0, "surfaces": 3.0}.get(name, 5.0)
    frames, _ = simulate_session(scene, "plastic", duration_s)
    if name == "surfaces":
        second = simulate_session(scene, "felt", 3.0)[0].copy()
        second["sequence"] += len(frames)
        second["time_ns"] += len(frames) * 1_000_000
        frames = np.concatenate([frames, second])
    settings = scene.texture.settings(scene.session.samples_per_frame)
    factory = ModellerFactory(settings, 0.5)
    offline, size = factory.make(), factory.frames_at_once
    blocks = [frames[k : k + size] for k in range(0, len(frames), size)]
    expected = []
    for block in blocks:
        update = offline.update(block)
        if update is not None and not (expected and factory.is_finished(expected[-1])):
            expected.append(update)
    found = []
    live = Modelling(Session(scene), ModellingProcess(settings, 0.5))
    live.deliver = lambda update, _: found.append(update)
    async with running(live):
        for block in blocks:  # faster than real time: the tasks work on several updates at once
            for part in np.array_split(block, 5):
                live.on_frames(part)
            while live.figures["segmenting"].queue_now > 2000:
                await asyncio.sleep(0.001)
        await live.finish(60.0)
        figures = {task: figure.as_dict() for task, figure in live.figures.items()}
    assert [described(update) for update in found] == [described(u) for u in expected]
    assert touched == (expected[-1].model is not None and expected[-1].model.touch_down is not None)
    assert all(figure["drops"] == 0 for figure in figures.values())
    assert all(figure["items"] >= len(expected) for figure in figures.values())
    assert all(0 < figure["median_ms"] <= figure["longest_ms"] for figure in figures.values())


class Works:
    """Works by number, which are joined as the process joins them."""

    def __init__(self):
        self.each = []
        self.absorbed = 0

    def item(self, removed=None, seconds=0.0):
        number, noted = len(self.each), object()
        made = UpdateWork(noted, float(number), [], [], removed or [], 0.0)
        segment = type("S", (), {"span": SampleRange(number, number + 1)})()
        made.added = [segment]
        self.each.append(made)
        return Item(number, seconds)

    def absorb(self, later, earlier, segments):
        self.each[later.number].merge(self.each[earlier.number], segments=segments)
        self.absorbed += 1

    def starts(self, item):
        return [segment.span.start for segment in self.each[item.number].added]


def test_a_full_queue_drops_the_oldest_segments_but_still_removes_what_they_removed():
    works = Works()
    task = StageTask("fit", None, 2, works.absorb, print)
    for k, drops in enumerate([0, 0, 1, 2]):
        task.put(works.item([SampleRange(k - 10, k - 9)]))
        assert task.figures.drops == works.absorbed == drops
    first = task.items[0]
    assert works.starts(first) == [2]
    assert works.each[first.number].removed == [(-10, -9), (-9, -8), (-8, -7)]


def test_a_task_that_cannot_keep_up_takes_all_as_one_update():
    works = Works()
    task = StageTask("fit", None, 4, works.absorb, print)
    for k in range(4):
        task.put(works.item([SampleRange(k - 1, k)] if k == 3 else [], 0.25))
    item = task.get()
    assert works.starts(item) == [0, 1, 3]  # segment 2 no longer holds
    assert item.seconds == 1.0
    assert task.get() is None
