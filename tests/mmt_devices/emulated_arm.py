"""The emulated HD device for a test, and waiting for what a device does."""

import time
from collections.abc import Callable, Iterator

import pytest

from mmt.core.errors import MmtError
from mmt.testing.emulated.hd import EmulatedHd

PATIENCE_S = 20.0


@pytest.fixture(name="emulated")
def emulated_arm() -> Iterator[EmulatedHd]:
    """A device that is there; the test is skipped where it cannot be compiled."""
    try:
        device = EmulatedHd()
    except MmtError as error:
        pytest.skip(str(error))
    device.start()
    yield device
    device.stop()


def until(condition: Callable[[], bool], act: Callable[[], object] = lambda: None) -> None:
    """Act every millisecond until the condition holds."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        act()
        assert time.monotonic() < deadline, "it has not come to pass"
        time.sleep(0.001)
