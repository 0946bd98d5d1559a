"""Run all sessions of a comparison in processes of this machine."""

from collections.abc import Callable, Sequence

from mmt_lab.methods.cases import Case
from mmt_lab.methods.certainty import Certainty, has_certainty, judge_certainty
from mmt_lab.methods.judging import Judged, blocks_of, judge
from mmt_lab.sweep.running import in_order


def judge_session(case: Case, methods: Sequence[str]) -> tuple[list[Judged], list[Certainty]]:
    """Judge methods on one session, and what those that know their uncertainty say of it."""
    blocks = blocks_of(case)
    sure = [judge_certainty(case, method, blocks) for method in methods if has_certainty(method)]
    return judge(case, methods, blocks), sure


def run_cases(
    cases: Sequence[Case],
    methods: Sequence[str],
    workers: int,
    progress: Callable[[int], None] = lambda _done: None,
) -> tuple[list[Judged], list[Certainty]]:
    """Judge every case; the result is in the order of the cases, whatever finished first.

    Parameters
    ----------
    cases, methods
        See `judge_session`.
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
    found = in_order(judge_session, calls, workers, progress)
    return (
        [one for judged, _ in found for one in judged],
        [one for _, sure in found for one in sure],
    )
