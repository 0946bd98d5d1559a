"""A session whose model is shared, and the processes beside it.

Its listeners join at once when the shared model is ready: they wait until it is, and join within
one second. They listen until the leader ends its session, or until a time is over in all. They
stand for other machines, whose work must not take the leader's processor: they count messages, and
the model is built once for all.
"""

import asyncio
import os
import re
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, Final

from mmt.cli.running.child import Child
from mmt.core.errors import MmtError
from mmt_lab.harness.processes import background_processes, be_apart, received
from mmt_lab.sharing.counting import ListenerCounts, run_listeners
from mmt_share.client import STATES_HZ, ListenerClient
from mmt_share.tables import Listening

_SCENE: Final = "rough-texture"
"""Scene whose model grows as long as the session lasts, so that there are changes to share."""
LAST_S: Final = 30.0
"""How long listeners may take to end after the session."""


class Service:
    """A service as a process, read line by line."""

    def __init__(self, child: Child) -> None:
        self.child, self._lines = child, child.lines()

    async def line(self, kind: str, pattern: str = "") -> dict[str, Any]:
        """Return the next line of a kind whose event matches a pattern."""
        async for line in self._lines:
            if line["kind"] == kind and re.search(pattern, str(line.get("event", ""))):
                return line
        raise MmtError(f"the {self.child.name} has ended: {self.child.messages}")


async def start_service(
    stack: AsyncExitStack,
    *command: str,
    prefix: Sequence[str] = (),
    environment: Mapping[str, str] = MappingProxyType({}),
) -> Service:
    """Start a command of `mmt.cli.running.child`, with additions to its environment."""
    arguments = [*command, "--json-lines"]
    variables = {**os.environ, **environment}
    module = "mmt.cli.running.child"
    child = await Child.start(command[0], module, arguments, variables, prefix=prefix)
    stack.push_async_callback(child.kill)
    return Service(child)


@dataclass(frozen=True)
class SharedSession:
    """A leader that shares its model at `url`, and the processes started beside it."""

    stack: AsyncExitStack
    leader: Service
    url: str
    link: str
    """URL to which the follower connects."""

    async def start_follower(self) -> None:
        """Start the follower."""
        await start_service(self.stack, "follower", _SCENE, "--leader", self.link)

    def listen(self, *calls: tuple[Any, ...]) -> list[Connection]:
        """Run listeners until the session is over; see `background_processes`."""
        return self.stack.enter_context(background_processes(*calls))


@asynccontextmanager
async def shared_session(duration_s: float) -> AsyncIterator[SharedSession]:
    """Run a leader until its model is shared, and on; the follower is not started yet."""
    async with AsyncExitStack() as stack:
        recording = Path(stack.enter_context(TemporaryDirectory())) / "session.mcap"
        options = ["--share", "--port", "0", "--duration", str(duration_s)]
        options += ["--record", str(recording)]
        port = {"MMT_SHARING__PORT": "0"}
        leader = await start_service(stack, "leader", _SCENE, *options, environment=port)
        link = f"http://127.0.0.1:{(await leader.line('ready'))['port']}"
        told = await leader.line("event", "^shared at ")
        yield SharedSession(stack, leader, str(told["event"]).removeprefix("shared at "), link)


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


async def run_with_listeners(
    duration_s: float, listeners: int
) -> tuple[dict[str, Any], list[ListenerCounts]]:
    """Run a session with a crowd; return the leader's summary and the listeners' counts."""
    async with shared_session(duration_s) as session:
        (pipe,) = session.listen((join_apart, session.url, duration_s + LAST_S, listeners))
        await session.leader.line("event", ", 1 listening")
        await session.start_follower()
        summary = await session.leader.line("summary")
        return summary, await asyncio.to_thread(received, pipe, LAST_S)
