"""What holds for every test: how the suite is spread over processes, and what is put back."""

import gc
import os
import sys
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

from mmt.process import ask_for_short_turns

SLOWEST_FIRST = ("services", "evaluation", "fuzz", "cli", "session", "link", "devices")
"""Folders whose files take longest: begun last, they would keep one process alone at the end."""

SWITCH_INTERVAL_S = sys.getswitchinterval()

# how long an example takes says more of the machine's load than of the example
settings.register_profile("mmt", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("mmt")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Run twice as many processes as there are cores: half of the time a test waits for a clock."""
    return min(2 * (os.cpu_count() or 1), 8)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with what takes longest, in every process alike."""
    if hasattr(config, "workerinput"):
        places = {name: place for place, name in enumerate(SLOWEST_FIRST)}
        items.sort(key=lambda item: places.get(item.path.parent.name, len(places)))


@pytest.fixture(autouse=True)
def _ordinary_process() -> Iterator[None]:
    """Put back what a service asks of its process: it would last, and children would inherit it."""
    yield
    if sys.getswitchinterval() != SWITCH_INTERVAL_S:
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        ask_for_short_turns(0)
        gc.unfreeze()
