"""Looks between the ticks: how many there are, and when they end."""

import asyncio
import time

import pytest

from mmt.core.running.ticking import LoopTimer, open_timer
from mmt.devices.streaming.polling import Retry

PATIENCE_S = 20.0


@pytest.fixture(autouse=True)
def _precise_timers():
    timer = open_timer()
    if timer is None:
        pytest.skip("this system has no precise timers")
    timer.close()


async def until(condition):
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            await asyncio.sleep(0.001)


def tried(ticks, lacks):
    """Return the looks after so many ticks without need and one that lacks something.

    `lacks` says how many looks find nothing.
    """

    async def run():
        looks = 0

        def look(_):
            nonlocal looks
            looks += 1
            return looks <= lacks

        retry = Retry(look)
        retry.start()
        for _ in range(ticks):
            retry.tick(lacking=False)
        retry.tick(lacking=True)
        if ticks >= 10:
            await until(lambda: looks > 0)
        await asyncio.sleep(0.02)
        retry.stop()
        return looks

    return asyncio.run(run())


def test_a_tick_that_lacks_a_reading_is_followed_by_looks_until_it_is_there():
    assert tried(100, 0) == 1
    assert 1 <= tried(100, 2) <= 3  # a machine held up for 20 ms sees fewer


def test_looks_that_find_nothing_are_bounded():
    assert tried(0, 1000) == 0
    assert 1 <= tried(25, 1000) <= 2
    assert 1 <= tried(95, 1000) <= 9


async def test_a_sensor_in_step_with_the_ticks_is_looked_for_at_each_of_them():
    """For as long as it takes to drift on, out of what was not looked for before."""
    looks = 0

    def look(_):
        nonlocal looks
        looks += 1
        return True

    retry = Retry(look)
    retry.start()
    for _ in range(1000):
        retry.tick(lacking=False)
    retry.tick(lacking=True)
    await until(lambda: looks > 50)
    retry.stop()


async def test_nothing_is_looked_for_after_the_end():
    calls = []
    timer = LoopTimer(calls.append)
    timer.start()
    timer.set(time.monotonic_ns() + 1_000_000)
    await until(lambda: calls)
    timer.set(time.monotonic_ns() + 1_000_000)
    timer.stop()
    timer.stop()
    timer.set(time.monotonic_ns() + 1_000_000)
    await asyncio.sleep(0.02)
    assert len(calls) == 1
