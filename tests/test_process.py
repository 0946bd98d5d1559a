import os
import sys
import time

import pytest

from mmt.process import ProcessMeter, ask_for_short_turns


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux's scheduler is asked")
def test_asking_for_short_turns_changes_neither_policy_nor_niceness() -> None:
    before = os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)
    assert ask_for_short_turns() in {True, False}
    assert (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)) == before


def test_the_meter_sees_work() -> None:
    meter, used_s, begun_s = ProcessMeter(), time.process_time(), time.monotonic()
    while time.process_time() - used_s < 0.5:
        sum(range(10_000))
    cost = meter.read()
    share = (time.process_time() - used_s) / (time.monotonic() - begun_s)
    assert cost.core_share == pytest.approx(share, rel=0.1)
    assert cost.memory_mb > 5
