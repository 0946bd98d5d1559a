"""A session whose model is shared, and the processes beside it."""

import asyncio
import os
import re
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
from mmt_lab.harness.processes import background_processes, received
from mmt_lab.sharing.counting import ListenerCounts
from mmt_lab.sharing.crowd import join_apart

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
