"""Python processes that a program starts, and the messages that it exchanges with them.

The program's end of the pipes closes however the program ends; its child ends then.
"""

import os
import pickle
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from tempfile import TemporaryFile
from typing import IO, Any, Final

from mmt.core.running.programs import handle_end_signals, python_command

_SHOWN_BYTES: Final = 10_000


class ChildProcess(subprocess.Popen[bytes]):
    """A Python process with pipes to its input and from its output, which Ctrl-C does not reach.

    Parameters
    ----------
    *arguments
        Arguments of Python, such as ``-m`` and a module.
    own_session
        Whether it has a process session, which `lower_priority` needs, or a process group of its
        own: Linux divides processor time among sessions first, and a small session beside large
        ones may wait long.
    keeps_errors
        Whether `close` tells what it wrote to its standard error.
    **options
        As of `subprocess.Popen`; `stdin` and `stdout` replace the pipes.
    """

    stdin: IO[bytes]
    stdout: IO[bytes]

    def __init__(
        self,
        *arguments: str,
        own_session: bool = True,
        keeps_errors: bool = False,
        **options: Any,
    ) -> None:
        self._errors = TemporaryFile() if keeps_errors else None  # noqa: SIM115 - until `close`
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        if self._errors is not None:
            pipes["stderr"] = self._errors
        super().__init__(
            python_command(*arguments),
            start_new_session=own_session,
            process_group=None if own_session else 0,
            **pipes | options,
        )

    def send(self, message: object) -> None:
        """Send a message, pickled; raise an `OSError` if the child has ended."""
        _write(self.stdin, message)

    def receive(self, longest_s: float | None = None) -> Any:
        """Return the child's next message.

        Raises
        ------
        EOFError
            The child has ended, or has sent nothing for `longest_s`.
        """
        if longest_s is not None and not select.select([self.stdout], [], [], longest_s)[0]:
            raise EOFError
        return _read(self.stdout)

    def ask(self, message: object, longest_s: float | None = None) -> Any:
        """Send a message and return the answer; raise an `EOFError` as `receive` does."""
        with suppress(OSError):  # it has ended; it may have written why
            self.send(message)
        return self.receive(longest_s)

    def end(self, longest_s: float | None) -> None:
        """Close the child's input; kill it unless it ends within `longest_s`."""
        with suppress(OSError):  # what it has not read cannot be sent any more
            self.stdin.close()
        try:
            self.wait(longest_s)
        except subprocess.TimeoutExpired:
            self.kill()
            self.wait()

    def close(self) -> str:
        """Kill the child if it runs, and close the pipes; calling it twice is harmless.

        Returns the last line that it wrote to standard error, "" if there is none or it is not
        kept.
        """
        self.kill()  # before its input is closed, which would wait until it has read
        with suppress(OSError), self:
            pass
        if self._errors is None or self._errors.closed:
            return ""
        with self._errors as kept:
            kept.seek(max(0, kept.seek(0, os.SEEK_END) - _SHOWN_BYTES))
            return kept.read().decode(errors="replace").strip().rpartition("\n")[2]


class Parent:
    """The program that has started this process, as a `ChildProcess`, for messages.

    Printed text goes to standard error from now on, so that it does not mix with the messages. The
    end signals are ignored: the parent says when this process ends.
    """

    def __init__(self) -> None:
        handle_end_signals(signal.SIG_IGN)
        self.output = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)

    def send(self, message: object) -> None:
        """Send a message, pickled; raise a `BrokenPipeError` if the parent has gone."""
        _write(self.output, message)

    def receive(self) -> Any:
        """Return the next message; raise an `EOFError` if the parent has gone."""
        return _read(sys.stdin.buffer)

    def __iter__(self) -> Iterator[Any]:
        """Yield messages until the parent has gone."""
        with suppress(EOFError):
            while True:
                yield self.receive()


def _read(stream: IO[bytes]) -> Any:
    """Return the next message; raise an `EOFError` if none comes, or only a part of one."""
    try:
        return pickle.load(stream)  # noqa: S301 - from our own child or parent
    except (OSError, pickle.UnpicklingError) as error:
        raise EOFError from error


def _write(stream: IO[bytes], message: object) -> None:
    pickle.dump(message, stream, pickle.HIGHEST_PROTOCOL)
    stream.flush()
