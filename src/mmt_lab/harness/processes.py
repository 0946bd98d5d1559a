"""Function calls in local processes, processes with pipes, and a progress bar."""

import asyncio
import inspect
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
from mmt.core.running.process import lower_priority

Result = TypeVar("Result")


def map_in_processes(
    function: Callable[..., Result],
    calls: Sequence[tuple[Any, ...]],
    *,
    what: str,
    workers: int | None = None,
) -> list[Result]:
    """Call a function in local processes with a progress bar; return results in the calls' order.

    Parameters
    ----------
    function
        Function of a module; its arguments and results can be pickled.
    calls
        The arguments of each call.
    what
        Label of the progress bar, a word or two.
    workers
        Number of processes; None for as many as there are processors. With 1 the calls run in
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
            found = ((number, function(*call)) for number, call in enumerate(calls))
        else:
            futures = in_processes(function, dict(enumerate(calls)), wanted)
            found = ((number, future.result()) for number, future in futures)
        for number, result in found:
            results[number] = result
            show(len(results))
    return [results[number] for number in sorted(results)]


def spawn_context() -> SpawnContext:
    """Return the context of processes that import nothing from the current folder.

    The variable has the effect of ``-P``, which cannot be added to multiprocessing's own command.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    return multiprocessing.get_context("spawn")


def in_processes(
    function: Callable[..., Result], calls: Mapping[int, tuple[Any, ...]], workers: int
) -> Iterator[tuple[int, Future[Result]]]:
    """Call a function in local processes; yield number and future of each call when it is done.

    ``calls`` has the arguments by number; else as `map_in_processes`.
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
def background_processes(*calls: tuple[Any, ...]) -> Iterator[list[Connection]]:
    """Run each function in its own process while the block runs.

    Parameters
    ----------
    calls
        Each a function of a module, async or not, and its arguments, which can be pickled.

    Yields
    ------
    list
        One end of a pipe to each function, which gets the other end as its first argument. The
        function should end when that raises `EOFError`, which is not reported.
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
    """Return the next message of a process of `background_processes`.

    Raises
    ------
    MmtError
        The process failed (its own `MmtError` if it sent one), or sent nothing in `timeout_s`.
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
    """Run a function of `background_processes`; send its `MmtError` if it raises one."""
    _leave_interrupts()
    try:
        running = function(pipe, *arguments)
        if inspect.iscoroutine(running):
            asyncio.run(running)
    except MmtError as error:
        pipe.send(error)
    except (EOFError, ConnectionError):
        pass  # the other end is closed: the function is no longer needed


def processes(workers: int | None, jobs: int) -> int:
    """Return how many processes to start: as asked for, else as many as there are processors."""
    return min(workers or os.cpu_count() or 1, max(1, jobs))


@contextmanager
def counting(
    what: str, total: int, *, done: int = 0, stays: bool = False
) -> Iterator[Callable[[int], None]]:
    """Show a progress bar while the block runs, and afterwards if it `stays`.

    Yields
    ------
    Callable
        Function to be called with the number of items done.
    """
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=messages, transient=not stays) as progress:
        task = progress.add_task("", total=total, completed=done)
        yield lambda now_done: progress.update(task, completed=now_done)


def _leave_interrupts() -> None:
    """Leave Ctrl-C to the process that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def be_apart() -> None:
    """Run at low priority in a process session of its own, as if on another machine."""
    if os.name == "posix":
        os.setsid()
    lower_priority()
