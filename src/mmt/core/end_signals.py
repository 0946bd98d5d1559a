"""The signals that ask a program to end: Ctrl-C, termination, and a terminal that is closed."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

_NAMES: Final = ("SIGINT", "SIGTERM", "SIGHUP")


def handle_end_signals(handler: Callable[[int, FrameType | None], Any] | signal.Handlers) -> None:
    """Set the handler of the end signals; SIGTERM and SIGHUP stay ignored if they are (nohup)."""
    for number in _numbers():
        if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def _numbers() -> list[signal.Signals]:
    return [getattr(signal, name) for name in _NAMES if hasattr(signal, name)]


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
