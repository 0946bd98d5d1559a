"""Start a command line; Ctrl-C while it is still being loaded ends it without a traceback.

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


def start(name: str) -> None:
    """Load the command line ``mmt.cli.<name>`` and run it."""
    usual = signal.signal(signal.SIGINT, _leave)
    module = importlib.import_module(f"mmt.cli.{name}")
    signal.signal(signal.SIGINT, usual)
    try:
        module.run()
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
