"""Comparable timings: methods take turns, and medians are given with their spread.

On a shared machine a single time says little. Here every method of a comparison runs once in
every round, and the order rotates from round to round, so that other load on the machine affects
all methods alike. The results are medians over rounds, and ratios of medians.
"""

import math
from collections.abc import Callable, Mapping
from timeit import timeit
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt_lab.harness.findings import Findings, FindingsTable, Side, Spread, Target

Task = Callable[[], object]

Figure = tuple[str, float | int | None] | tuple[str, float | int | None, Side, float]
"""Name and value of a figure; then the side and the bound of its target, if it has one."""

LEAST_S: Final = 0.002
"""Least length of a task's turn in a round; a shorter task is repeated."""


def interleave(tasks: Mapping[str, Task], rounds: int) -> dict[str, Spread]:
    """Time tasks in turns, without garbage collection; return the seconds of one call of each.

    Parameters
    ----------
    tasks
        Tasks by name; each is called twice before the rounds.
    rounds
        How often every task has its turn, at least 1.
    """
    calls = {name: _calls(task) for name, task in tasks.items()}
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    names = list(tasks)
    for number in range(rounds):
        shift = number % max(1, len(names))
        for name in names[shift:] + names[:shift]:
            seconds[name].append(timeit(tasks[name], number=calls[name]) / calls[name])
    return {name: spread(np.array(values)) for name, values in seconds.items()}


def spread(values: FloatArray) -> Spread:
    """Return median and quartiles."""
    low, median, high = np.percentile(values, [25.0, 50.0, 75.0])
    return Spread(float(median), float(low), float(high))


def single_figures(title: str, about: str, figures: Mapping[str, Figure]) -> Findings:
    """Return single figures, given by their names in JSON, as the findings of a stage."""
    rows = figures.values()
    return Findings(
        title,
        about,
        records=(
            FindingsTable(
                "figures", title, tuple({"what": row[0], "measured": row[1]} for row in rows)
            ),
        ),
        targets=tuple(Target(*row) for row in rows if len(row) == 4),
        figures={name: row[1] for name, row in figures.items()},
    )


def _calls(task: Task) -> int:
    task()
    once_s = timeit(task, number=1)
    return max(1, min(100_000, math.ceil(LEAST_S / max(once_s, 1e-8))))
