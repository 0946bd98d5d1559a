"""Modelling at the first start: it waits for the compiler, and works off what has waited."""

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from frame_samples import made_frames

from mmt.core.kernel_cache import Compilation
from mmt.leader.modelling import Modelling
from mmt.leader.part import Session
from mmt.scene.files import load_scene


class SlowCompilation(Compilation):
    """A compilation that is done when a test says so, or when it is stopped."""

    def __init__(self) -> None:
        super().__init__({}, [])
        self.done = threading.Event()

    def finish(self) -> None:
        assert self.done.wait(30)

    def stop(self) -> None:
        self.done.set()


class FirstStart:
    """A session's modelling whose kernels are being compiled."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.compilation = SlowCompilation()
        self.session = Session(
            load_scene(Path("demo")), self.said.append, compilation=self.compilation
        )
        made = Modelling.build(self.session)
        assert made is not None
        self.modelling = made
        self.times_s: list[float] = []
        made._on_update = lambda update, _: self.times_s.append(update.time_s)


@pytest.fixture
async def first_start() -> AsyncIterator[FirstStart]:
    made = FirstStart()
    async with running(made.modelling):
        yield made


@asynccontextmanager
async def running(modelling: Modelling) -> AsyncIterator[None]:
    tasks = [asyncio.create_task(run) for run in modelling.tasks().values()]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        modelling.close()


async def test_every_period_that_waited_for_the_compiler_is_modelled_by_itself(
    first_start: FirstStart,
) -> None:
    for first in range(0, 30_000, 500):
        first_start.modelling.on_frames(made_frames(first, 500))
    await asyncio.sleep(0.05)
    assert first_start.times_s == []
    assert not first_start.modelling.working
    threading.Timer(0.05, first_start.compilation.done.set).start()
    await first_start.modelling.finish()
    assert first_start.modelling.dropped_frames == 0
    assert first_start.times_s == [float(s) for s in range(1, 31)]
    assert "modelling begins: 30000 frames have waited" in first_start.said


async def test_a_person_who_stops_the_session_does_not_wait_for_the_compiler(
    first_start: FirstStart,
) -> None:
    first_start.modelling.on_frames(made_frames(0, 3000))
    first_start.session.ending.stop("stopped")
    await first_start.modelling.finish()
    assert not first_start.compilation.done.is_set()
    assert first_start.said == ["modelling had not begun; mmt model build does it later"]
