"""A service as a child process that reports in JSON lines.

``python -m mmt.cli.child leader`` is ``mmt-leader`` that ends in order when its standard input
does, which the system closes however its starter ends.
"""

import asyncio
import json
import os
import signal
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import suppress
from typing import Any, Final

from mmt.cli.entry import start
from mmt.core.children import python_command

_LONGEST_LINE: Final = 2**20
_KEPT_MESSAGES: Final = 2**16
"""Bytes of what a child writes to standard error that are kept, the newest."""
KILL: Final = signal.SIGKILL if sys.platform != "win32" else signal.SIGTERM
"""Ends a process at once, on every system."""
_WARNING: Final = b"warning: "
"""How the line of one begins; see `mmt.core.logs`."""


class Child:
    """One service as a process group of its own, so that Ctrl-C reaches the parent alone.

    What it writes to standard error is read all the while: it never waits for a reader.
    """

    def __init__(
        self,
        name: str,
        process: asyncio.subprocess.Process,
        started_s: float,
        on_warning: Callable[[str], None],
    ) -> None:
        self.name = name
        self._on_warning = on_warning
        self._started_s = started_s
        self._process = process
        self._kept = b""
        self._interrupted = False
        self._reading = asyncio.create_task(self._read_messages())

    @classmethod
    async def start(
        cls,
        name: str,
        module: str,
        arguments: list[str],
        environment: Mapping[str, str] | None = None,
        on_warning: Callable[[str], None] = lambda _: None,
    ) -> "Child":
        """Run ``python -m module``.

        Parameters
        ----------
        name
            What a person calls it.
        module, arguments
            What is run.
        environment
            None for this process's own.
        on_warning
            Called with each warning that it logs, when it does.
        """
        started_s = time.perf_counter()
        process = await asyncio.create_subprocess_exec(
            *python_command("-m", module, *arguments),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            limit=_LONGEST_LINE,
            # not a session of its own: Linux divides the processor among sessions first, and a
            # small one beside others waits for long
            process_group=0 if os.name == "posix" else None,
            env=environment,
        )
        return cls(name, process, started_s, on_warning)

    async def lines(self) -> AsyncIterator[dict[str, Any]]:
        """Yield its JSON lines until it closes its standard output.

        A line that is none, as a device's driver may print, is yielded as an event.
        """
        assert self._process.stdout is not None  # noqa: S101 - it was asked for
        async for raw in self._process.stdout:
            yield _parsed(raw)

    async def wait(self) -> int:
        """Wait for its end and return the exit code."""
        await asyncio.wait([self._reading])
        return await self._process.wait()

    @property
    def age_s(self) -> float:
        """Seconds since it was started."""
        return time.perf_counter() - self._started_s

    @property
    def messages(self) -> str:
        """What it wrote to standard error, the newest part of much."""
        return self._kept.decode(errors="replace").strip()

    @property
    def pid(self) -> int:
        """The number of its process."""
        return self._process.pid

    def interrupt(self) -> None:
        """Ask it to end in order, once: a second signal would end it at once."""
        if not self._interrupted:
            self._interrupted = True
            self.send(signal.SIGTERM)  # SIGINT may be ignored, and is inherited so

    def send(self, number: signal.Signals) -> None:
        """Send it a signal; nothing happens to one that has ended."""
        send(self._process, number)

    async def kill(self) -> None:
        """End it at once; nothing happens to one that has ended."""
        self.send(KILL)
        await self.wait()

    async def _read_messages(self) -> None:
        assert self._process.stderr is not None  # noqa: S101 - it was asked for
        rest = b""
        while part := await self._process.stderr.read(_KEPT_MESSAGES):
            self._kept = (self._kept + part)[-_KEPT_MESSAGES:]
            *lines, rest = (rest + part).split(b"\n")
            rest = rest[:_KEPT_MESSAGES]
            for line in lines:
                if line.startswith(_WARNING):
                    self._on_warning(line.decode(errors="replace"))


def send(process: asyncio.subprocess.Process, number: signal.Signals) -> None:
    """Send a process a signal; nothing happens to one that has ended.

    Not by `subprocess`, which looks first whether it has ended: then asyncio, which waits for
    that too, misses its exit code, and says so on standard error.
    """
    if process.returncode is None:
        with suppress(ProcessLookupError):
            os.kill(process.pid, number)


def _parsed(raw: bytes) -> dict[str, Any]:
    try:
        line = json.loads(raw)
    except ValueError:
        line = None
    if isinstance(line, dict) and "kind" in line:
        return line
    return {"kind": "event", "event": raw.decode(errors="replace").strip()}


def _end_with_starter() -> None:
    while os.read(0, 1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    threading.Thread(target=_end_with_starter, name="starter", daemon=True).start()
    start(sys.argv.pop(1))
