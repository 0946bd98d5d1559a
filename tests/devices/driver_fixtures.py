"""Fixtures for tests of drivers: what is started is stopped, and what is opened is closed."""

import pytest

from mmt.devices import board_sharing


@pytest.fixture(autouse=True)
def own_calibrations(tmp_path, monkeypatch):
    """Keep stored calibrations in a folder of the test's own."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))


@pytest.fixture
def started():
    """Starts emulated devices, and stops them at the end."""
    running = []

    def start(device):
        device.start()
        running.append(device)
        return device

    yield start
    for device in reversed(running):
        device.stop()


@pytest.fixture
def closing():
    """Closes devices at the end, which leaves no board open."""
    before = list(board_sharing.OPEN_BOARDS)
    opened = []

    def keep(device):
        opened.append(device)
        return device

    yield keep
    for device in reversed(opened):
        device.close()
    assert before == board_sharing.OPEN_BOARDS


@pytest.fixture
def connected(closing):
    """Connects devices, and closes them at the end."""

    def connect(device):
        closing(device).connect()
        return device

    return connect
