"""The emulated HD device for a test."""

import pytest

from mmt.core.errors import MmtError
from mmt.testing.emulated.openhaptics.hd import EmulatedHd


@pytest.fixture(name="emulated")
def emulated_arm(started):
    """A device that is there; the test is skipped where it cannot be compiled."""
    try:
        device = EmulatedHd()
    except MmtError as error:
        pytest.skip(str(error))
    return started(device)
