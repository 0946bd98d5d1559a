"""The tasks, threads and modules of the running process, sampled while it runs."""

import asyncio
import re
import sys
import threading
from collections import Counter
from collections.abc import Coroutine
from typing import Any, Final, TypeVar

import psutil

Result = TypeVar("Result")

PERIOD_S: Final = 0.25
"""Time between two samples; one takes some tens of microseconds."""

_OWN: Final = "inventory"
_MAIN: Final = "main"
_UNNAMED: Final = re.compile(r"Task-\d+")


class Inventory:
    """Sample the tasks and threads of this process several times a second."""

    def __init__(self) -> None:
        self._looks = 0
        self._tasks: Counter[str] = Counter()
        self._threads: Counter[str] = Counter()
        self._most_threads = 0

    async def watch(self, running: Coroutine[Any, Any, Result]) -> Result:
        """Await the coroutine, sample until it returns, and return its result."""
        this_task = asyncio.current_task()
        if this_task is not None:
            this_task.set_name(_MAIN)
        looking = asyncio.create_task(self._sample_until_cancelled(), name=_OWN)
        try:
            return await running
        finally:
            looking.cancel()

    def sample(self) -> None:
        """Count the tasks of the running loop and the threads of the process."""
        self._looks += 1
        names = (name_of(task) for task in asyncio.all_tasks())
        self._tasks.update({name for name in names if name != _OWN})
        self._threads.update({thread.name for thread in threading.enumerate()})
        self._most_threads = max(self._most_threads, psutil.Process().num_threads())

    def as_dict(self) -> dict[str, Any]:
        """Return the names seen with their counts, the number of samples, and imported modules.

        ``system_threads`` includes threads of compiled libraries, which have no name.
        """
        return {
            "looks": self._looks,
            "tasks": dict(self._tasks.most_common()),
            "threads": dict(self._threads.most_common()),
            "system_threads": self._most_threads,
            "modules": [name for name, module in list(sys.modules.items()) if _imported(module)],
        }

    async def _sample_until_cancelled(self) -> None:
        while True:
            await asyncio.sleep(PERIOD_S)
            self.sample()


def _imported(module: object) -> bool:
    """Return whether a module was imported; compiled packages create some in other ways."""
    return getattr(module, "__spec__", None) is not None


def name_of(task: "asyncio.Task[Any]") -> str:
    """Return a task's name, or that of its package and coroutine if the task has none."""
    if not _UNNAMED.fullmatch(task.get_name()):
        return task.get_name()
    coroutine = task.get_coro()
    name = getattr(coroutine, "__qualname__", None) or type(coroutine).__name__
    frame = getattr(coroutine, "cr_frame", None)
    package = frame.f_globals.get("__name__", "") if frame is not None else ""
    return f"{package.partition('.')[0]}: {name}" if package else str(name)
