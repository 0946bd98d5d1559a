import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from mmt.core import realtime
from mmt.core.errors import MmtError
from mmt.core.realtime import PRIORITY, be_real_time, follow_real_time, require_real_time

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux's scheduler is asked")


def permitted() -> bool:
    try:
        require_real_time()
    except MmtError:
        return False
    return True


def in_a_thread(function: Callable[[], object]) -> object:
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(function).result(60.0)


@pytest.mark.skipif(not permitted(), reason="this user may not schedule in real time")
def test_the_thread_that_asks_is_real_time_and_what_it_starts_is_not() -> None:
    def ask() -> tuple[int, int, list[int]]:
        be_real_time()
        found: list[int] = []
        child = threading.Thread(target=lambda: found.append(os.sched_getscheduler(0)))
        child.start()
        child.join(60.0)
        return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, found

    before = os.sched_getscheduler(0)
    assert in_a_thread(ask) == (
        os.SCHED_FIFO | os.SCHED_RESET_ON_FORK,
        PRIORITY,
        [os.SCHED_OTHER],
    )
    require_real_time()
    assert os.sched_getscheduler(0) == before


@pytest.mark.skipif(not permitted(), reason="this user may not schedule in real time")
def test_a_thread_may_follow_the_one_that_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(realtime, "_TICKS", threading.Event())

    def follow() -> int:
        follow_real_time()
        return os.sched_getscheduler(0)

    assert in_a_thread(follow) == os.SCHED_OTHER
    in_a_thread(be_real_time)
    assert in_a_thread(follow) == os.SCHED_FIFO | os.SCHED_RESET_ON_FORK


def test_a_thread_that_may_not_follow_stays_an_ordinary_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    ticks = threading.Event()
    ticks.set()
    monkeypatch.setattr(realtime, "_TICKS", ticks)
    before = os.sched_getscheduler(0)
    follow_real_time()
    assert os.sched_getscheduler(0) == before


def test_where_it_is_not_permitted_a_sentence_says_how_to(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    for function in (be_real_time, require_real_time):
        with pytest.raises(MmtError, match=r"not permitted .*rtprio 20.*LimitRTPRIO"):
            function()


def test_other_systems_have_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(MmtError, match="on Linux alone"):
        be_real_time()
