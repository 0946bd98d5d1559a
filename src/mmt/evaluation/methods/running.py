"""Run all sessions of a comparison in processes of this machine."""

from collections.abc import Callable, Sequence

from mmt.evaluation.methods.cases import Case
from mmt.evaluation.methods.judging import Judged, judge
from mmt.evaluation.sweeping import in_order


def run_cases(
    cases: Sequence[Case],
    methods: Sequence[str],
    workers: int,
    progress: Callable[[int], None] = lambda _done: None,
) -> list[Judged]:
    """Judge every case; the result is in the order of the cases, whatever finished first.

    Parameters
    ----------
    cases, methods
        See `judge`.
    workers
        Number of processes.
    progress
        Called with how many are done.

    Raises
    ------
    MmtError
        A process has died.
    """
    calls = [(case, tuple(methods)) for case in cases]
    return [one for judged in in_order(judge, calls, workers, progress) for one in judged]
