"""The two services of a soak as processes, with a proxy between them, and samples of both."""

import asyncio
import os
import signal
import time
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Any, Final, Self

import psutil

from mmt.cli.running.child import Child
from mmt.core.errors import MmtError
from mmt_lab.harness.proxy import Proxy
from mmt_lab.soak.judging import PATIENCE_S, ServiceSample, SoakLog

_SCENE: Final = "demo"
_LONGEST_SESSION_S: Final = "86400"
_START_S: Final = 120.0
_END_S: Final = 15.0


class SoakServices:
    """Leader and follower of the demo's scene with an emulated network.

    On entry of the context both run and the stream has begun; on exit both have been ended.
    """

    def __init__(
        self, recording: Path, seed: int, on_status: Callable[[dict[str, Any]], None]
    ) -> None:
        self._recording = recording
        self._environment = {
            **os.environ,
            "MMT_NETWORK__SEED": str(seed),
            "MMT_LINK__PATIENCE_S": str(PATIENCE_S),
            "MMT_LINK__KEEP_S": str(PATIENCE_S),
        }
        self._on_status = on_status
        self._leader: Child | None = None
        self._follower: Child | None = None
        self._killed: set[Child] = set()
        self._stack = AsyncExitStack()
        self._watching: list[asyncio.Task[None]] = []
        self._ready = asyncio.Event()
        self._streaming = asyncio.Event()
        self.proxy: Proxy
        """Proxy through which the follower connects."""
        self.ended = asyncio.Event()
        """Set when the leader has ended, or a follower has failed."""
        self.port = 0
        """Port of the leader."""
        self.log = SoakLog()

    async def __aenter__(self) -> Self:
        async with self._stack as stack:
            stack.push_async_callback(self._end_watching)
            arguments = ["--port", "0", "--duration", _LONGEST_SESSION_S]
            arguments += ["--record", str(self._recording)]
            self._leader = await self._start("leader", arguments, self._watch_leader)
            await self._until(self._ready, "the leader was not ready")
            self.proxy = await stack.enter_async_context(Proxy(self.port))
            await self._start_follower()
            await self._until(self._streaming, "the stream did not begin")
            self._stack = stack.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()

    async def _end_watching(self) -> None:
        await asyncio.gather(*self._watching, return_exceptions=True)

    async def finish(self) -> None:
        """End the session by an interrupt, as a user would, and wait for the summary."""
        if self._leader is not None:
            self._leader.interrupt()
        with suppress(TimeoutError):
            async with asyncio.timeout(_END_S):
                await asyncio.gather(*self._watching)
        if not self.log.leader:
            self.log.errors.append(f"the leader did not end within {_END_S:g} s")

    async def pause(self, leader: bool, length_s: float) -> None:
        """Stop the leader's or the follower's process for `length_s`."""
        child = self._leader if leader else self._follower
        if child is None:
            return
        child.send(signal.SIGSTOP)
        try:
            await asyncio.sleep(length_s)
        finally:
            child.send(signal.SIGCONT)

    async def restart_follower(self, after_s: float) -> None:
        """Kill the follower and start another one `after_s` later."""
        if self._follower is not None:
            self._killed.add(self._follower)
            await self._follower.kill()
        await asyncio.sleep(after_s)
        await self._start_follower()

    async def _start_follower(self) -> None:
        arguments = ["--leader", f"http://127.0.0.1:{self.proxy.port}"]
        self._follower = await self._start("follower", arguments, self._watch_follower)
        self.log.lives_s.append(time.monotonic())

    async def _start(
        self, name: str, arguments: list[str], watch: Callable[[Child], Coroutine[Any, Any, None]]
    ) -> Child:
        arguments = [name, _SCENE, *arguments, "--json-lines"]
        child = await Child.start(name, "mmt.cli.running.child", arguments, self._environment)
        self._stack.push_async_callback(child.kill)
        self._watching.append(asyncio.create_task(watch(child)))
        return child

    async def _until(self, event: asyncio.Event, otherwise: str) -> None:
        waiting = [asyncio.create_task(e.wait()) for e in (event, self.ended)]
        await asyncio.wait(waiting, timeout=_START_S, return_when=asyncio.FIRST_COMPLETED)
        for task in waiting:
            task.cancel()
        if not event.is_set():
            raise MmtError("; ".join([otherwise, *self.log.errors]))

    async def _watch_leader(self, leader: Child) -> None:
        async for line in leader.lines():
            if line["kind"] == "ready":
                self.port = int(line["port"])
                self._ready.set()
            elif line["kind"] == "status":
                self._take_status(line, leader)
            elif line["kind"] == "summary":
                self.log.leader = {key: value for key, value in line.items() if key != "kind"}
        code = await leader.wait()
        if code != 0 or not self.log.leader:
            self.log.errors.append(f"the leader ended with exit code {code}: {leader.messages}")
        elif self.log.leader["outcome"] != "stopped":
            self.log.errors.append(f"the leader ended by itself: {self.log.leader['outcome']}")
        self.ended.set()

    async def _watch_follower(self, follower: Child) -> None:
        async for _ in follower.lines():
            pass
        code = await follower.wait()
        if follower not in self._killed and code != 0:
            self.log.errors.append(f"the follower ended with exit code {code}: {follower.messages}")
            self.ended.set()

    def _take_status(self, status: dict[str, Any], leader: Child) -> None:
        if status["frames"]:
            self._streaming.set()
        if self._streaming.is_set():
            self.log.samples.append(
                ServiceSample(
                    time_s=time.monotonic(),
                    leader_mb=_memory_mb(leader),
                    modelling_mb=_memory_mb(leader, of_its_own=True),
                    follower_mb=_memory_mb(self._follower),
                    ticks=status["ticks"],
                    late_ticks=status["late_ticks"],
                )
            )
        self._on_status(status)


def _memory_mb(child: Child | None, *, of_its_own: bool = False) -> float | None:
    """Return the memory of a process, or of those that it has started; None if there is none."""
    if child is None:
        return None
    try:
        process = psutil.Process(child.pid)
        processes = process.children() if of_its_own else [process]
        return sum(each.memory_info().rss for each in processes) / 1e6 if processes else None
    except psutil.Error:
        return None
