"""Processes that talk in lines: words to them, JSON from them."""

import json
import queue
import subprocess
import sys
import threading
import time
from typing import Any

from mmt.core.errors import MmtError


def say(content: dict[str, Any]) -> None:
    """Print a line of JSON, from within a child."""
    sys.stdout.write(json.dumps(content) + "\n")
    sys.stdout.flush()


class Child:
    """A module of ours, running as a process of its own.

    Parameters
    ----------
    module
        Its name.
    arguments
        Of its command line.
    """

    def __init__(self, module: str, *arguments: str) -> None:
        self._module = module
        self._process = subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-m", module, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for us, who end it
        )
        self._lines: queue.Queue[str] = queue.Queue()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def tell(self, line: str) -> None:
        """Give it a line."""
        said = self._process.stdin
        assert said is not None  # noqa: S101 - a pipe was asked for
        try:
            said.write(line + "\n")
            said.flush()
        except BrokenPipeError:
            raise self._ended() from None

    def hear(self, longest_s: float) -> dict[str, Any]:
        """Return its next line.

        Raises
        ------
        MmtError
            It ends, or says nothing for so long.
        """
        try:
            line = self._lines.get(timeout=longest_s)
        except queue.Empty:
            raise MmtError(f"{self._module} says nothing for {longest_s:g} s") from None
        if not line:
            raise self._ended()
        answer: dict[str, Any] = json.loads(line)
        return answer

    def hear_of(self, key: str, value: object, longest_s: float) -> dict[str, Any]:
        """Return its next line that has this value at this key; see `hear`."""
        deadline = time.monotonic() + longest_s
        while True:
            answer = self.hear(max(0.0, deadline - time.monotonic()))
            if answer.get(key) == value:
                return answer

    def ask(self, line: str, longest_s: float) -> dict[str, Any]:
        """Give it a line and return its answer; see `hear`."""
        self.tell(line)
        return self.hear(longest_s)

    def finish(self) -> None:
        """Let it come to its end."""
        said = self._process.stdin
        assert said is not None  # noqa: S101 - a pipe was asked for
        try:
            said.close()
        except BrokenPipeError:
            return

    def close(self) -> None:
        """End it; calling it twice is harmless."""
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
        return MmtError(f"{self._module} has ended: {lines[-1] if lines else 'it says nothing'}")
