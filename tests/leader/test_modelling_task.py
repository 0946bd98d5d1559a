"""The modelling task: what it gives to a modeller, when, and what it drops."""

import asyncio
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress

import numpy as np
import pytest
from frame_samples import made_frames

from mmt.core.arrays import RecordArray
from mmt.leader.modelling import ModellingTask
from mmt.texture.completion.distance import CompletionMonitor
from mmt.texture.online import modellers
from mmt.texture.online.modeller import ModelUpdate
from mmt.texture.settings import ModellingSettings


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
            progress=CompletionMonitor().progress,
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
        monkeypatch.setattr(modellers, "OnlineModeller", self._make)
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


async def test_an_update_that_fails_comes_out_of_the_task(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = Modelled(0.1, monkeypatch)
    monkeypatch.setattr(made.modeller, "stages", lambda frames: 1 / 0)
    made.task.take(made_frames(0, 100))
    with pytest.raises(ZeroDivisionError):
        await asyncio.wait_for(made.task.run(), 10)


async def test_a_frozen_model_takes_no_frames_until_it_may_grow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with modelled(monkeypatch) as made:
        made.task.take(made_frames(0, 50))
        made.task.freeze(True)
        made.task.take(made_frames(50, 100))
        made.task.fill(made_frames(150, 100))
        made.task.freeze(False)
        made.task.take(made_frames(500, 100))
        await made.settle(1)
        np.testing.assert_array_equal(made.modeller.updates[0]["sequence"], np.arange(500, 600))
        made.task.freeze(True)
        made.task.reset()
        assert not made.task.frozen
