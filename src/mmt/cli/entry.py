"""Start a command line; Ctrl-C ends it without a traceback, also while it is still being loaded.

``python -m mmt.cli.entry leader`` is ``mmt-leader``. Nothing but the standard library is
imported here, so that Ctrl-C is handled almost from the start.
"""

import importlib
import os
import signal
import sys
from types import FrameType
from typing import Final

INTERRUPTED: Final = 130


def _leave(_number: int, _frame: FrameType | None) -> None:
    """End at once: nothing runs yet that would have to be ended in order."""
    os.write(sys.stderr.fileno(), b"stopped\n")
    os._exit(INTERRUPTED)


def _interrupted(error: BaseException | None) -> bool:
    """Return whether Ctrl-C led to an error, however a library has translated it since."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def start(name: str) -> None:
    """Load the command line ``mmt.cli.<name>`` and run it."""
    usual = signal.signal(signal.SIGINT, _leave)
    module = importlib.import_module(f"mmt.cli.{name}")
    signal.signal(signal.SIGINT, usual)
    try:
        module.run()
    except (KeyboardInterrupt, SystemExit) as error:  # typer's own code depends on its version
        if not _interrupted(error):
            raise
        sys.stderr.write("stopped\n")
        sys.exit(INTERRUPTED)
    finally:  # a late Ctrl-C would kill the interpreter as it closes, and with it the exit code
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def mmt() -> None:
    """Run ``mmt``."""
    start("main")


def leader() -> None:
    """Run ``mmt-leader``."""
    start("leader")


def follower() -> None:
    """Run ``mmt-follower``."""
    start("follower")


def listen() -> None:
    """Run ``mmt-listen``."""
    start("listener")


if __name__ == "__main__":
    start(sys.argv.pop(1))
