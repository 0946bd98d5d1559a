"""Child processes: lines of text to their input, lines of JSON from their output."""

import json
import queue
import subprocess
import sys
import threading
import time
from typing import Any, Final

from mmt.core.children import python_command
from mmt.core.errors import MmtError

START_S: Final = 60.0
"""How long a child may take until it is ready."""
ANSWER_S: Final = 20.0
"""How long it may take to answer."""


def say(content: dict[str, Any]) -> None:
    """Print a line of JSON, in the child."""
    sys.stdout.write(json.dumps(content) + "\n")
    sys.stdout.flush()


class BenchChild:
    """A module of this package that runs as a process of its own.

    Parameters
    ----------
    module
        Its name.
    arguments
        Arguments of its command line.
    """

    def __init__(self, module: str, *arguments: str) -> None:
        self._module = module
        self._process = subprocess.Popen(  # noqa: S603 - our own module
            python_command("-m", module, *arguments),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for us, who end it
        )
        self._lines: queue.Queue[str] = queue.Queue()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def send(self, line: str) -> None:
        """Write a line to its input."""
        said = self._process.stdin
        assert said is not None  # noqa: S101 - a pipe was asked for
        try:
            said.write(line + "\n")
            said.flush()
        except BrokenPipeError:
            raise self._ended() from None

    def receive(self, longest_s: float) -> dict[str, Any]:
        """Return its next line of output.

        Raises
        ------
        MmtError
            It has ended, or printed nothing within `longest_s`.
        """
        try:
            line = self._lines.get(timeout=longest_s)
        except queue.Empty:
            raise MmtError(f"{self._module} printed nothing for {longest_s:g} s") from None
        if not line:
            raise self._ended()
        answer: dict[str, Any] = json.loads(line)
        return answer

    def receive_where(self, key: str, value: object, longest_s: float) -> dict[str, Any]:
        """Return its next line that has this value at this key, skipping others; see `receive`."""
        deadline = time.monotonic() + longest_s
        while True:
            answer = self.receive(max(0.0, deadline - time.monotonic()))
            if answer.get(key) == value:
                return answer

    def ask(self, line: str, longest_s: float) -> dict[str, Any]:
        """Write a line to its input and return its answer; see `receive`."""
        self.send(line)
        return self.receive(longest_s)

    def finish(self) -> None:
        """Close its input, at which it ends."""
        said = self._process.stdin
        assert said is not None  # noqa: S101 - a pipe was asked for
        try:
            said.close()
        except BrokenPipeError:
            return

    def close(self) -> None:
        """Close its input, wait, and kill it if it stays; calling it twice is harmless."""
        self.finish()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._listener.join(5.0)
        for pipe in (self._process.stdout, self._process.stderr):
            if pipe is not None:
                pipe.close()

    def _listen(self) -> None:
        said = self._process.stdout
        assert said is not None  # noqa: S101 - a pipe was asked for
        for line in said:
            self._lines.put(line)
        self._lines.put("")

    def _ended(self) -> MmtError:
        self._process.wait()
        complaint = self._process.stderr
        lines = complaint.read().strip().splitlines() if complaint is not None else []
        return MmtError(f"{self._module} has ended: {lines[-1] if lines else 'no message'}")


def keep_for(
    duration_s: float, job: dict[str, Any], *, lab: BenchChild, reader: BenchChild, settle_s: float
) -> None:
    """Give a reader its job, and let it keep for so long what it reads of a lab that has settled.

    Raises
    ------
    MmtError
        One of them has ended, or does not answer.
    """
    reader.send(json.dumps(job))
    reader.receive_where("ready", True, START_S)
    lab.ask("begin", ANSWER_S)
    time.sleep(min(settle_s, duration_s))
    reader.send("begin")
    time.sleep(duration_s)
