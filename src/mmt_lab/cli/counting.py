"""What the commands with many sessions share: names, numbers of processes, a bar that counts."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from mmt.cli.common import messages
from mmt.core.errors import InputError


class Counted(Protocol):
    """Called with how many are done, and of how many where that was not known before."""

    def __call__(self, done: int, every: int | None = None, /) -> None:
        """Show it."""


@contextmanager
def counting(what: str, total: int = 1, *, done: int = 0, stays: bool = False) -> Iterator[Counted]:
    """Show how many are done while the block runs, and afterwards where it `stays`."""
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=messages, transient=not stays) as progress:
        task = progress.add_task("", total=total, completed=done)

        def show(done: int, every: int | None = None, /) -> None:
            progress.update(task, completed=done, total=every)

        yield show


def names_of(given: str | None) -> list[str] | None:
    """Return the names between the commas of an option, None where it was not given."""
    return None if given is None else [name.strip() for name in given.split(",")]


def check_workers(workers: int | None) -> None:
    """Refuse a number of processes that is none.

    Raises
    ------
    InputError
        It is below 1.
    """
    if workers is not None and workers < 1:
        raise InputError(f"--workers {workers}: at least 1")


def processes(workers: int | None, jobs: int) -> int:
    """Return how many processes to start: as asked for, else as many as there are processors."""
    return min(workers or os.cpu_count() or 1, max(1, jobs))
