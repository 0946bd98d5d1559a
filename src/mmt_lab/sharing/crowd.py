"""Listeners that join at once when a shared model is ready.

They wait until the model is ready, and join within one second. They listen until the leader ends
its session, or until a time is over in all. They stand for other machines, whose work must not take
the leader's processor: they count messages, and the model is built once for all.
"""

import asyncio
import time
from multiprocessing.connection import Connection

from mmt.core.errors import MmtError
from mmt_lab.harness.processes import be_apart
from mmt_lab.sharing.counting import ListenerCounts, run_listeners
from mmt_share.client import STATES_HZ, ListenerClient
from mmt_share.tables import Listening


async def wait_until_ready(url: str) -> float:
    """Wait until the shared model is ready, build it, and leave; return the seconds to build it."""
    over = asyncio.Event()

    def hear(text: str) -> None:
        if "has ended" in text or "cut off" in text:
            over.set()

    client = ListenerClient(Listening(url=url), on_event=hear)

    async def ready() -> None:
        while (await client.next_state())[1] is None:
            pass

    waiting = [asyncio.create_task(each) for each in (ready(), over.wait())]
    try:
        await client.connect()
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        if not waiting[0].done():
            raise MmtError("the session ended before its model was ready")
        started_s = time.monotonic()
        await asyncio.to_thread(client.replica.build)
        return time.monotonic() - started_s
    finally:
        for task in waiting:
            task.cancel()
        await client.close()


async def crowd(url: str, listeners: int, longest_s: float) -> list[ListenerCounts]:
    """Let the crowd join when the model is ready; if it never is, each reports that problem."""
    begun_s = time.monotonic()
    try:
        async with asyncio.timeout(longest_s):
            building_s = await wait_until_ready(url)
    except (MmtError, TimeoutError) as error:
        problem = str(error) or f"no model was ready within {longest_s:g} s"
        return [ListenerCounts(problem=problem) for _ in range(listeners)]
    left_s = longest_s - (time.monotonic() - begun_s)
    found = await run_listeners(url, listeners, left_s, within_s=1.0, states_hz=STATES_HZ)
    for each in found:
        if each.first_s is not None:
            each.first_s += building_s
    return found


async def join_apart(pipe: Connection, url: str, longest_s: float, listeners: int) -> None:
    """Run a crowd at low priority, as if on other machines; send its counts."""
    be_apart()
    pipe.send(await crowd(url, listeners, longest_s))
