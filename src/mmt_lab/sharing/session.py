"""A session whose model is shared, and the processes beside it."""

import asyncio
import os
import re
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, Final

from mmt.cli.running.child import Child
from mmt.core.errors import MmtError
from mmt_lab.harness.processes import background_processes, received

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


class ListenedSession:
    """A leader that shares its model, and the processes started beside it."""

    def __init__(self, stack: AsyncExitStack) -> None:
        self._stack = stack
        self.leader: Service
        self.url = ""
        """URL at which the model is shared."""
        self._link = ""

    async def start_leader(self, duration_s: float) -> None:
        """Start the leader, and wait until its model is shared."""
        recording = Path(self._stack.enter_context(TemporaryDirectory())) / "session.mcap"
        options = ["--share", "--port", "0", "--duration", str(duration_s)]
        options += ["--record", str(recording)]
        self.leader = await self.start(
            "leader", _SCENE, *options, environment={"MMT_SHARING__PORT": "0"}
        )
        self._link = f"http://127.0.0.1:{(await self.leader.line('ready'))['port']}"
        told = await self.leader.line("event", "^shared at ")
        self.url = str(told["event"]).removeprefix("shared at ")

    async def start_follower(self) -> None:
        """Start the follower."""
        await self.start("follower", _SCENE, "--leader", self._link)

    async def start(
        self,
        *command: str,
        prefix: Sequence[str] = (),
        environment: Mapping[str, str] = MappingProxyType({}),
    ) -> Service:
        """Start a command of `mmt.cli.running.child`, with additions to its environment."""
        child = await Child.start(
            command[0],
            "mmt.cli.running.child",
            [*command, "--json-lines"],
            {**os.environ, **environment},
            prefix=prefix,
        )
        self._stack.push_async_callback(child.kill)
        return Service(child)

    def listen(self, *calls: tuple[Any, ...]) -> list[Connection]:
        """Run listeners until the session is over; see `background_processes`."""
        return self._stack.enter_context(background_processes(*calls))


@asynccontextmanager
async def shared_session(duration_s: float) -> AsyncIterator[ListenedSession]:
    """Run a leader that shares its model; the follower is not started yet."""
    async with AsyncExitStack() as stack:
        session = ListenedSession(stack)
        await session.start_leader(duration_s)
        yield session


async def run_with_listeners(
    duration_s: float, join: Callable[..., object], listeners: int
) -> tuple[dict[str, Any], Any]:
    """Run one session with listeners; return the leader's summary and the listeners' results.

    ``join`` runs them in a process of its own, given a pipe, the URL, the longest time and their
    number.
    """
    async with shared_session(duration_s) as session:
        (pipe,) = session.listen((join, session.url, duration_s + LAST_S, listeners))
        await session.leader.line("event", ", 1 listening")
        await session.start_follower()
        summary = await session.leader.line("summary")
        return summary, await asyncio.to_thread(received, pipe, LAST_S)
