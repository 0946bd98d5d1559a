"""The signals that ask a program to end: Ctrl-C, termination, and a terminal that is closed."""

import signal
from collections.abc import Callable
from types import FrameType
from typing import Any, Final

_NAMES: Final = ("SIGINT", "SIGTERM", "SIGHUP")


def handle_end_signals(handler: Callable[[int, FrameType | None], Any] | signal.Handlers) -> None:
    """Set the handler of all of them; a hangup that is ignored, as under ``nohup``, stays so."""
    for number in (getattr(signal, name) for name in _NAMES if hasattr(signal, name)):
        if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def on_end_signal(act: Callable[[], None]) -> None:
    """Call a function at the first of them; the next one but a hangup ends the process at once.

    The shell and the system both tell of a terminal that is closed.
    """

    def first(_number: int, _frame: FrameType | None) -> None:
        handle_end_signals(signal.SIG_DFL)
        if hasattr(signal, "SIGHUP"):
            signal.signal(signal.SIGHUP, signal.SIG_IGN)
        act()

    handle_end_signals(first)
