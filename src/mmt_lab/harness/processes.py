"""Calls in processes of this machine, and a bar that counts them."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.context import SpawnContext
from typing import Any, TypeVar

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from mmt.cli.common import messages
from mmt.core.errors import MmtError

Result = TypeVar("Result")


def each(
    function: Callable[..., Result],
    calls: Sequence[tuple[Any, ...]],
    *,
    what: str,
    workers: int | None = None,
) -> list[Result]:
    """Call a function in processes and count the calls; return results in the calls' order.

    Parameters
    ----------
    function
        Belongs to a module; its arguments and results can be pickled.
    calls
        The arguments of each call.
    what
        What is counted, in a word or two.
    workers
        Number of processes, as many as there are processors where it is None. One alone is
        this process itself.

    Raises
    ------
    MmtError
        A process has died.
    """
    wanted = processes(workers, len(calls))
    results: dict[int, Result] = {}
    with counting(what, len(calls)) as show:
        if wanted == 1:
            for number, call in enumerate(calls):
                results[number] = function(*call)
                show(len(results))
        else:
            for number, future in in_processes(function, dict(enumerate(calls)), wanted):
                results[number] = future.result()
                show(len(results))
    return [results[number] for number in sorted(results)]


def spawn_context() -> SpawnContext:
    """Return the context of processes that import nothing from the current folder.

    The variable stands for what `mmt.core.children.python_command` says: the command is not ours.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    return multiprocessing.get_context("spawn")


def in_processes(
    function: Callable[..., Result], calls: Mapping[int, tuple[Any, ...]], workers: int
) -> Iterator[tuple[int, Future[Result]]]:
    """Call a function in processes of this machine; yield each call's number as it is done.

    Parameters
    ----------
    function
        Belongs to a module; its arguments and results can be pickled.
    calls
        Arguments by number.
    workers
        Number of processes.

    Raises
    ------
    MmtError
        A process has died.
    """
    pool = ProcessPoolExecutor(
        max_workers=workers,
        mp_context=spawn_context(),
        initializer=_leave_interrupts,
    )
    try:
        futures = {pool.submit(function, *call): number for number, call in calls.items()}
        for future in as_completed(futures):
            if isinstance(future.exception(), BrokenProcessPool):
                raise MmtError("a process has died; start it again to go on")
            yield futures[future], future
    except BrokenProcessPool as error:
        raise MmtError("a process has died; start it again to go on") from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def processes(workers: int | None, jobs: int) -> int:
    """Return how many processes to start: as asked for, else as many as there are processors."""
    return min(workers or os.cpu_count() or 1, max(1, jobs))


@contextmanager
def counting(
    what: str, total: int, *, done: int = 0, stays: bool = False
) -> Iterator[Callable[[int], None]]:
    """Show a bar while the block runs, and afterwards where it `stays`.

    Yields
    ------
    Callable
        Called with how many are done.
    """
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=messages, transient=not stays) as progress:
        task = progress.add_task("", total=total, completed=done)
        yield lambda now_done: progress.update(task, completed=now_done)


def _leave_interrupts() -> None:
    """Leave Ctrl-C to the process that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
