"""Start and end programs: the command of a Python process, and the signals that ask one to end."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

_END_SIGNALS: Final = ("SIGINT", "SIGTERM", "SIGHUP")
"""Ctrl-C, termination, and a terminal that is closed."""


def python_command(*arguments: str) -> list[str]:
    """Return the command of a Python process that imports nothing from the current folder.

    A file there with the name of a standard module, such as ``random.py``, would be imported in
    its place. Folders in `PYTHONPATH` are still searched.
    """
    return [sys.executable, "-P", *arguments]


def import_path() -> str:
    """Return a `PYTHONPATH` with which a child can import the modules that this process can."""
    from pathlib import Path  # not at the start of a program, where Ctrl-C is not handled yet

    named = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    here = {Path.cwd()} - {Path(each).resolve() for each in named}
    return os.pathsep.join(each for each in sys.path if each and Path(each).resolve() not in here)


def handle_end_signals(handler: Callable[[int, FrameType | None], Any] | signal.Handlers) -> None:
    """Set the handler of the end signals; SIGTERM and SIGHUP stay ignored if they are (nohup)."""
    for number in _numbers():
        if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def _numbers() -> list[signal.Signals]:
    return [getattr(signal, name) for name in _END_SIGNALS if hasattr(signal, name)]


@contextmanager
def restoring_end_signals() -> Iterator[None]:
    """Restore the handlers of the end signals after the block, unless such a signal has come."""
    before = {number: signal.getsignal(number) for number in _numbers()}
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) != signal.SIG_DFL:
            for number, handler in before.items():
                signal.signal(number, handler)


def on_end_signal(act: Callable[[], None]) -> None:
    """Call a function at the first end signal; the next one ends the process at once.

    SIGHUP is ignored after the first one: for a closed terminal, shell and system both send it.
    """

    def first(_number: int, _frame: FrameType | None) -> None:
        handle_end_signals(signal.SIG_DFL)
        if hasattr(signal, "SIGHUP"):
            signal.signal(signal.SIGHUP, signal.SIG_IGN)
        act()

    handle_end_signals(first)


def when_parent_ends(act: Callable[[], object]) -> None:
    """Call a function, in a thread, once nothing more can come from standard input."""

    def wait() -> None:
        while os.read(0, 1):
            pass
        act()

    threading.Thread(target=wait, name="parent", daemon=True).start()
