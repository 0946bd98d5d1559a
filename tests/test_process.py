import os
import sys

import pytest

from mmt.process import ProcessMeter, ask_for_short_turns


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux's scheduler is asked")
def test_asking_for_short_turns_changes_neither_policy_nor_niceness() -> None:
    before = os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)
    assert ask_for_short_turns() in {True, False}
    assert (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)) == before


def test_the_meter_sees_work() -> None:
    meter = ProcessMeter()
    total = 0
    while meter.read().core_share < 0.2:
        total += sum(range(10_000))
    cost = meter.read()
    assert total > 0
    assert cost.memory_mb > 5
