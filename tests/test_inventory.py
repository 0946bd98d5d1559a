"""What a process says of its own tasks, threads and modules."""

import asyncio
import sys
import threading
import types
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from mmt.core import inventory
from mmt.core.inventory import Inventory, name_of


async def lingering() -> None:
    await asyncio.sleep(60)


@contextmanager
def waiting_thread(name: str) -> Iterator[None]:
    leave = threading.Event()
    thread = threading.Thread(target=leave.wait, name=name)
    thread.start()
    try:
        yield
    finally:
        leave.set()
        thread.join(60.0)


async def test_what_runs_is_found_and_counted() -> None:
    tasks = [asyncio.create_task(lingering()), asyncio.create_task(lingering(), name="told")]
    await asyncio.sleep(0)
    found = Inventory()
    found.sample()
    tasks[1].cancel()
    await asyncio.wait([tasks[1]])
    with waiting_thread("at work"):
        found.sample()
    seen = found.as_dict()
    assert seen["looks"] == 2
    assert seen["tasks"]["test_inventory: lingering"] == 2
    assert seen["tasks"]["told"] == 1
    assert seen["threads"]["MainThread"] == 2
    assert seen["threads"]["at work"] == 1
    assert seen["system_threads"] >= 2
    tasks[0].cancel()


async def test_a_task_of_a_library_is_named_by_its_package() -> None:
    task = asyncio.create_task(asyncio.Event().wait())
    await asyncio.sleep(0)
    assert name_of(task) == "asyncio: Event.wait"
    task.cancel()


def test_modules_are_those_that_were_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "made_up_at_run_time", types.ModuleType("made_up"))
    modules = Inventory().as_dict()["modules"]
    assert {"asyncio", "mmt.core.inventory", "numpy"} & set(modules) >= {
        "asyncio",
        "mmt.core.inventory",
    }
    assert "made_up_at_run_time" not in modules


def test_it_looks_while_something_runs_and_returns_its_result(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(inventory, "PERIOD_S", 0.001)
    found = Inventory()

    async def running() -> str:
        other = asyncio.create_task(lingering(), name="beside")
        while found.as_dict()["looks"] < 3:
            await asyncio.sleep(0.001)
        other.cancel()
        return "done"

    assert asyncio.run(found.watch(running())) == "done"
    assert set(found.as_dict()["tasks"]) == {"main", "beside"}


def test_a_failure_comes_through() -> None:
    async def failing() -> None:
        raise ValueError("as it was")

    with pytest.raises(ValueError, match="as it was"):
        asyncio.run(Inventory().watch(failing()))
