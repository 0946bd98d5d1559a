"""Start a command line; Ctrl-C ends it without a traceback, even while it is still loading.

``python -m mmt.cli.entry leader`` runs ``mmt-leader``. This module imports little, so that Ctrl-C
is handled almost from the start.
"""

import importlib
import os
import select
import signal
import sys
from contextlib import suppress
from io import TextIOWrapper
from types import FrameType
from typing import Final

from mmt.core.running.programs import handle_end_signals

INTERRUPTED: Final = 130


def _leave(_number: int, _frame: FrameType | None) -> None:
    """End the process at once, since nothing runs yet that needs an orderly end."""
    _say_stopped()
    os._exit(INTERRUPTED)


def _say_stopped() -> None:
    """Write "stopped" to standard error, if that does not block."""
    with suppress(OSError):
        if sys.platform == "win32" or select.select([], [2], [], 0.0)[1]:
            os.write(2, b"stopped\n")


def _interrupted(error: BaseException | None) -> bool:
    """Return whether Ctrl-C caused an error, also if a library replaced the exception."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def _mend_streams() -> None:
    """Open standard streams that were closed before the start, and let none fail at a character.

    The next file opened would take a closed stream's place.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(descriptor, True)
            setattr(sys, name, os.fdopen(descriptor, "r" if name == "stdin" else "w"))
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # as standard error is


def start(name: str) -> None:
    """Import ``mmt.cli.<name>``, or a module by its dotted name, and call its `run`."""
    _mend_streams()
    usual = signal.getsignal(signal.SIGINT)
    handle_end_signals(_leave)
    module = importlib.import_module(name if "." in name else f"mmt.cli.{name}")
    handle_end_signals(signal.default_int_handler)
    signal.signal(signal.SIGINT, usual)  # a shell without job control ignores it in the background
    try:
        module.run()
    except (KeyboardInterrupt, SystemExit) as error:  # typer's exit code depends on its version
        if not _interrupted(error):
            raise
        _say_stopped()
        sys.exit(INTERRUPTED)
    finally:  # a late signal would kill the interpreter at exit and change the exit code
        handle_end_signals(signal.SIG_IGN)


def mmt() -> None:
    """Run ``mmt``."""
    start("main")


def leader() -> None:
    """Run ``mmt-leader``."""
    start("leader")


def follower() -> None:
    """Run ``mmt-follower``."""
    start("follower")


if __name__ == "__main__":
    start(sys.argv.pop(1))
