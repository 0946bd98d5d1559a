"""Cancelling what may swallow it."""

import asyncio

from mmt.core.running.ending import cancel_until_ended


async def test_a_task_that_swallows_a_cancellation_is_asked_again():
    swallowed = 0

    async def stubborn():
        nonlocal swallowed
        while True:
            try:
                await asyncio.sleep(3600.0)
            except asyncio.CancelledError:
                swallowed += 1
                if swallowed == 2:
                    raise

    async def failed():
        raise ValueError("its own")

    tasks = [asyncio.ensure_future(stubborn()), asyncio.ensure_future(failed())]
    await asyncio.sleep(0)
    async with asyncio.timeout(10.0):
        await cancel_until_ended(tasks)
    assert swallowed == 2
    assert all(task.done() for task in tasks)
    await cancel_until_ended([])
