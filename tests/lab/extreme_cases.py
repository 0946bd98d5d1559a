"""What the tests of the stiff and extreme cases share."""

from mmt_lab.stability.families import run_case


def those_that_do_not_hold(family, cases):
    rows = [run_case(family, case) for case in cases]
    return [f"{row.what}: {row.got}" for row in rows if not row.held]


def case_of(cases, words):
    return next(case for case in cases if words in case.what)
