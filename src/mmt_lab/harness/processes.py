"""Calls in processes of this machine, processes to talk to, and a bar that counts."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection
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


@contextmanager
def beside(*calls: tuple[Any, ...]) -> Iterator[list[Connection]]:
    """Run functions in processes of their own while the block runs.

    Parameters
    ----------
    calls
        Each a function of a module and its arguments, which can be pickled.

    Yields
    ------
    list
        The end of a pipe to each; the function gets the other end as its first argument. It is to
        return when that says `EOFError`, which is silent.
    """
    context = spawn_context()
    pipes: list[Connection] = []
    started = []
    try:
        for call in calls:
            here, there = context.Pipe()
            pipes.append(here)
            started.append(context.Process(target=_piped, args=(there, *call)))
            started[-1].start()
            there.close()
        yield pipes
    finally:
        for pipe in pipes:
            pipe.close()
        for process in started:
            if process.pid is not None:
                process.join(5.0)
                process.terminate()
                process.join()
            process.close()


def received(pipe: Connection, timeout_s: float) -> Any:
    """Return what a process of `beside` sent next.

    Raises
    ------
    MmtError
        It has failed, with its own error where that is one, or sent nothing for so long.
    """
    if not pipe.poll(timeout_s):
        raise MmtError(f"a process gave nothing in {timeout_s:g} s")
    try:
        answer = pipe.recv()
    except EOFError as error:
        raise MmtError("a process has failed") from error
    if isinstance(answer, MmtError):
        raise answer
    return answer


def _piped(pipe: Connection, function: Callable[..., object], *arguments: Any) -> None:
    """Run a function of `beside`, and send the error that it ends with."""
    _leave_interrupts()
    try:
        function(pipe, *arguments)
    except MmtError as error:
        pipe.send(error)
    except (EOFError, ConnectionError):
        pass  # the other end is closed: it is no longer wanted


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
