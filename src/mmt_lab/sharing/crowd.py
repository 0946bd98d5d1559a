"""Many listeners in one process, which take a shared model and render nothing.

``python -m mmt_lab.sharing.crowd URL SECONDS COUNT`` waits until the model is ready, lets so many
join within one second, listens until the leader ends its session, or for so long in all, and prints
as JSON what each has found.

Ten of them, spread over the second, are a user's client and build the model. The others stand for
other machines, whose work would take the leader's processor here: they count what comes, and their
time to a built model is that to its arrival and what building took the ten, by the median.
"""

import asyncio
import json
import sys
import time
from dataclasses import asdict
from statistics import median
from typing import Final

from mmt.core.errors import MmtError
from mmt.core.process import step_back
from mmt_lab.sharing.counting import Count, Counter, auth_of
from mmt_share.client import STATES_HZ, ListenerClient
from mmt_share.tables import Listening

_BUILDERS: Final = 10
"""Listeners that are a user's client and build the model."""


async def listen(url: str, after_s: float, ended: asyncio.Event, building: asyncio.Lock) -> Count:
    """Join after some seconds, and listen until the end."""
    found, ready = Count(), asyncio.Event()

    def take() -> None:
        replica = client.replica
        if replica.about is not None and replica.about.ready:
            ready.set()
        if client.changes:
            found.lags_ms.append(1e-6 * (time.monotonic_ns() - replica.made_ns))

    def say(text: str) -> None:
        if _is_end(text):
            ended.set()

    client = ListenerClient(Listening(url=url), on_model=take, on_event=say)
    await asyncio.sleep(after_s)
    begun_s = time.monotonic()
    try:
        await client.connect()
        waiting = asyncio.create_task(ready.wait())
        over = asyncio.create_task(ended.wait())
        await asyncio.wait([waiting, over], return_when=asyncio.FIRST_COMPLETED)
        if ready.is_set():
            waited_s = time.monotonic() - begun_s
            async with building:  # each would have a processor of its own
                started_s = time.monotonic()
                await asyncio.to_thread(client.replica.build)
                found.building_s = time.monotonic() - started_s
            found.first_s = waited_s + found.building_s
        await over
        waiting.cancel()
    except MmtError as error:
        found.problem = str(error)
    await client.close()
    found.number, found.rejected = client.replica.number, client.rejected
    return found


async def _count(url: str, after_s: float, ended: asyncio.Event) -> Count:
    """Join after some seconds, and count what comes until the end."""
    counter = Counter(url, auth_of(url, STATES_HZ))
    await asyncio.sleep(after_s)
    await counter.join()
    stopping = [asyncio.create_task(each.wait()) for each in (counter.ended, ended)]
    await asyncio.wait(stopping, return_when=asyncio.FIRST_COMPLETED)
    for task in stopping:
        task.cancel()
    return await counter.leave()


async def wait_until_ready(url: str) -> None:
    """Listen until the shared model is ready, and leave.

    Raises
    ------
    MmtError
        Nobody shares a model there, or the session has ended before.
    """
    ended = asyncio.Event()
    client = ListenerClient(
        Listening(url=url), on_event=lambda text: ended.set() if _is_end(text) else None
    )

    async def ready() -> None:
        while (await client.next_state()).model is None:
            pass

    waiting = asyncio.create_task(ready())
    over = asyncio.create_task(ended.wait())
    try:
        await client.connect()
        await asyncio.wait([waiting, over], return_when=asyncio.FIRST_COMPLETED)
        if not waiting.done():
            raise MmtError("the session ended before its model was ready")
    finally:
        waiting.cancel()
        over.cancel()
        await client.close()


def _is_end(text: str) -> bool:
    """Whether a listener's event says that nothing more will come."""
    return "has ended" in text or "cut off" in text


async def crowd(url: str, count: int, longest_s: float) -> list[Count]:
    """Let listeners join within one second; return what each has found."""
    ended, building = asyncio.Event(), asyncio.Lock()
    asyncio.get_running_loop().call_later(longest_s, ended.set)
    each_nth = max(1, count // _BUILDERS)
    found = await asyncio.gather(
        *(
            listen(url, number / count, ended, building)
            if number % each_nth == 0
            else _count(url, number / count, ended)
            for number in range(count)
        )
    )
    took = [each.building_s for each in found if each.building_s is not None]
    for each in found:
        if each.first_s is not None and each.building_s is None and took:
            each.first_s += median(took)
    return found


async def waiting_crowd(url: str, count: int, longest_s: float) -> list[Count]:
    """Let the crowd join when the model is ready; if it never is, that is the problem of each."""
    begun_s = time.monotonic()
    try:
        async with asyncio.timeout(longest_s):
            await wait_until_ready(url)
    except (MmtError, TimeoutError) as error:
        problem = str(error) or f"no model was ready within {longest_s:g} s"
        return [Count(problem=problem) for _ in range(count)]
    return await crowd(url, count, longest_s - (time.monotonic() - begun_s))


def main() -> None:
    """Run the crowd of the command line, which stands for other machines: it steps back."""
    step_back()
    url, longest_s, count = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
    found = asyncio.run(waiting_crowd(url, count, longest_s))
    print(json.dumps([asdict(each) for each in found]))


if __name__ == "__main__":
    main()
