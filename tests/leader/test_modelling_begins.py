"""Modelling at the first start: it waits for the compiler, and works off what has waited."""

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from frame_samples import made_frames

from mmt.core.kernel_cache import Compilation
from mmt.leader.modelling.pipeline import Modelling
from mmt.leader.part import Session
from mmt.leader.parts import first_numerics_of, numerics_of
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
        self.times_s: list[float] = []
        made = Modelling.build(self.session, lambda update, _: self.times_s.append(update.time_s))
        assert made is not None
        self.modelling = made


@pytest.fixture
async def first_start() -> AsyncIterator[FirstStart]:
    made = FirstStart()
    async with running(made.modelling):
        yield made


@asynccontextmanager
async def running(modelling: Modelling) -> AsyncIterator[None]:
    modelling.connect()
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
    first_start.compilation.done.set()
    async with asyncio.timeout(30):
        while len(first_start.times_s) < 30:
            await asyncio.sleep(0.005)
    await first_start.modelling.finish()
    assert first_start.modelling.dropped_frames == 0
    assert first_start.times_s == [float(s) for s in range(1, 31)]
    assert "modelling begins: 30000 frames have waited" in first_start.said


@pytest.mark.parametrize("outcome", ["stopped", "completed"])
async def test_a_session_that_ends_before_says_so_and_does_not_wait_for_the_compiler(
    first_start: FirstStart, outcome: str
) -> None:
    first_start.modelling.on_frames(made_frames(0, 3000))
    first_start.session.ending.stop(outcome)
    await first_start.modelling.finish()
    assert not first_start.compilation.done.is_set()
    assert first_start.said == ["modelling had not begun; mmt model build does it later"]


@pytest.mark.parametrize(("duration_s", "waits"), [(18.0, True), (120.0, True), (600.0, False)])
def test_a_short_session_begins_when_its_modelling_can(duration_s: float, waits: bool) -> None:
    scene = load_scene(Path("demo"), {"session.duration_s": duration_s})
    first = first_numerics_of(scene)
    assert (first is None) == waits
    assert first is None or set(first) < set(numerics_of(scene))
