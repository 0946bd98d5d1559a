"""Wait for what goes on beside a test: in threads, processes and emulated devices."""

import time

import psutil
import pytest

from mmt.core.errors import DeviceLost, MmtError

PATIENCE_S = 30.0


def until(condition, act=lambda: None):
    """Act every millisecond until the condition holds."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        act()
        assert time.monotonic() < deadline_s, "it has not come to pass"
        time.sleep(0.001)


def until_lost(act, words):
    """Act every millisecond until the device is lost, and says these words."""
    with pytest.raises(DeviceLost, match=words):
        until(lambda: False, act)


def check_refused(act, words, kind=MmtError):
    """See that what is tried, as to connect, is refused in these words."""
    with pytest.raises(kind, match=words):
        act()


def children(word, parent=None):
    """Return the child processes, of this one by default, that have a word in their command."""
    return [
        child for child in psutil.Process(parent).children() if word in " ".join(child.cmdline())
    ]
