"""Fixtures for tests of drivers: what is started is stopped, and what is opened is closed."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mmt.devices import board_sharing

Keep = Callable[[Any], Any]
"""Takes a device, and returns it."""


@pytest.fixture(autouse=True)
def own_calibrations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep stored calibrations in a folder of the test's own."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))


@pytest.fixture(name="started")
def started_devices() -> Iterator[Keep]:
    """Starts emulated devices, and stops them at the end."""
    running: list[Any] = []

    def start(device: Any) -> Any:
        device.start()
        running.append(device)
        return device

    yield start
    for device in reversed(running):
        device.stop()


@pytest.fixture(name="closing")
def closed_devices() -> Iterator[Keep]:
    """Closes devices at the end, which leaves no board open."""
    before = list(board_sharing.OPEN_BOARDS)
    opened: list[Any] = []

    def keep(device: Any) -> Any:
        opened.append(device)
        return device

    yield keep
    for device in reversed(opened):
        device.close()
    assert before == board_sharing.OPEN_BOARDS


@pytest.fixture(name="connected")
def connected_devices(closing: Keep) -> Keep:
    """Connects devices, and closes them at the end."""

    def connect(device: Any) -> Any:
        closing(device).connect()
        return device

    return connect
