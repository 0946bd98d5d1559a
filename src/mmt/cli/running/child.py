"""Run a service as a child process that reports in JSON lines.

``python -m mmt.cli.running.child leader`` runs ``mmt-leader``, and ends it in order when the parent
ends.
"""

import asyncio
import json
import os
import signal
import sys
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Final

from mmt.cli.entry import start
from mmt.core.running.programs import python_command, when_parent_ends

_LONGEST_LINE: Final = 2**20
_KEPT_MESSAGES: Final = 2**16
"""Number of newest bytes of a child's standard error that are kept."""
KILL: Final = signal.SIGKILL if sys.platform != "win32" else signal.SIGTERM
"""Signal that ends a process at once, on every system."""
_WARNING: Final = b"warning: "
"""Prefix of a line with a warning; see `mmt.core.output.logs`."""


class Child:
    """A service in its own process group, so that Ctrl-C reaches only the parent.

    Its standard error is read continuously, so that writing there never blocks the service.
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
        *,
        prefix: Sequence[str] = (),
    ) -> "Child":
        """Run ``python -m module``.

        Parameters
        ----------
        name
            Name for messages.
        module, arguments
            The module to run, and its arguments.
        environment
            Environment of the child; None for this process's environment.
        on_warning
            Called with each warning as soon as the child logs it.
        prefix
            Start of the command, such as one that enters a network namespace.
        """
        started_s = time.perf_counter()
        process = await asyncio.create_subprocess_exec(
            *prefix,
            *python_command("-m", module, *arguments),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            limit=_LONGEST_LINE,
            # not its own session: Linux divides processor time among sessions first, and a small
            # session beside large ones may wait long
            process_group=0 if os.name == "posix" else None,
            env=environment,
        )
        return cls(name, process, started_s, on_warning)

    async def lines(self) -> AsyncIterator[dict[str, Any]]:
        """Yield the child's JSON lines until it closes its standard output.

        Other lines, which a device's driver may print, are yielded as events.
        """
        assert self._process.stdout is not None  # noqa: S101 - it was opened as a pipe
        async for raw in self._process.stdout:
            yield _parsed(raw)

    async def wait(self) -> int:
        """Wait for the child's end and return the exit code."""
        await asyncio.wait([self._reading])
        return await self._process.wait()

    @property
    def age_s(self) -> float:
        """Seconds since the start of the child."""
        return time.perf_counter() - self._started_s

    @property
    def messages(self) -> str:
        """The newest part of the child's standard error."""
        return self._kept.decode(errors="replace").strip()

    @property
    def pid(self) -> int:
        """Process id of the child."""
        return self._process.pid

    def interrupt(self) -> None:
        """Ask the child to end in order, only once: a second signal would end it at once."""
        if not self._interrupted:
            self._interrupted = True
            self.send(signal.SIGTERM)  # a child may have inherited that SIGINT is ignored

    def send(self, number: signal.Signals) -> None:
        """Send the child a signal, if it has not ended."""
        send(self._process, number)

    async def kill(self) -> None:
        """End the child at once, if it has not ended."""
        self.send(KILL)
        await self.wait()

    async def _read_messages(self) -> None:
        assert self._process.stderr is not None  # noqa: S101 - it was opened as a pipe
        rest = b""
        while part := await self._process.stderr.read(_KEPT_MESSAGES):
            self._kept = (self._kept + part)[-_KEPT_MESSAGES:]
            *lines, rest = (rest + part).split(b"\n")
            rest = rest[:_KEPT_MESSAGES]
            for line in lines:
                if line.startswith(_WARNING):
                    self._on_warning(line.decode(errors="replace"))


def send(process: asyncio.subprocess.Process, number: signal.Signals) -> None:
    """Send a process a signal, if it has not ended.

    `subprocess` would poll the process first; asyncio, which waits for the process too, would
    then miss the exit code and print a warning.
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


if __name__ == "__main__":
    when_parent_ends(lambda: os.kill(os.getpid(), signal.SIGTERM))
    start(sys.argv.pop(1))
