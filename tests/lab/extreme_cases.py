"""What the tests of the stiff and extreme cases share."""

from mmt_lab.stability.cases import Extreme, run_case


def those_that_do_not_hold(family: str, cases: list[Extreme]) -> list[str]:
    rows = [run_case(family, case) for case in cases]
    return [f"{row.what}: {row.got}" for row in rows if not row.held]


def case_of(cases: list[Extreme], words: str) -> Extreme:
    return next(case for case in cases if words in case.what)
