import os
import platform
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from python_programs import printed_by

from mmt.core.errors import MmtError
from mmt.core.running import process
from mmt.core.running.process import (
    PRIORITY,
    ProcessMeter,
    ask_for_short_turns,
    be_real_time,
    follow_real_time,
    require_real_time,
    wake_on_time,
)

ON_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="Linux's own calls are used")
NOT_PERMITTED = "this user may not schedule in real time"


@ON_LINUX
def test_asking_for_short_turns_changes_neither_policy_nor_niceness():
    before = os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)
    assert ask_for_short_turns() in {True, False}
    assert (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)) == before


@ON_LINUX
def test_a_process_that_steps_back_gives_up_the_short_turns_of_its_parent():
    number = {"x86_64": 315, "aarch64": 275}.get(platform.machine())
    if number is None:
        pytest.skip("the number of sched_getattr is known for x86_64 and aarch64")
    script = f"""
import ctypes, struct
from mmt.core.running.process import ask_for_short_turns, lower_priority
def turn_ns():
    attributes = ctypes.create_string_buffer(48)
    assert ctypes.CDLL(None).syscall({number}, 0, attributes, 48, 0) == 0
    return struct.unpack("<IIQiIQQQ", attributes.raw)[5]
ask_for_short_turns(0)
kernels, asked = turn_ns(), ask_for_short_turns()
short = turn_ns()
lower_priority()
print(asked, kernels, short, turn_ns())
"""
    asked, kernels, short, after = printed_by("-c", script).split()
    if asked != "True" or kernels == "0":
        pytest.skip("this kernel has one length of turn for all")
    assert int(short) < int(kernels) == int(after)


@ON_LINUX
def test_memory_that_was_freed_between_blocks_that_live_goes_back_to_the_system():
    script = """
import psutil
from mmt.core.running.process import release_freed_memory
def held_mb():
    return psutil.Process().memory_info().rss / 1e6
blocks = [bytes(8192) + b"x" for _ in range(5000)]
kept = blocks[::100]
del blocks
before = held_mb()
print(release_freed_memory(), before - held_mb())
"""
    released, given_mb = printed_by("-c", script).split()
    if released != "True":
        pytest.skip("this C library keeps nothing to give back")
    assert float(given_mb) > 10.0


def test_the_meter_sees_work():
    meter, used_s, begun_s = ProcessMeter(), time.process_time(), time.monotonic()
    while time.process_time() - used_s < 0.5:
        sum(range(10_000))
    cost = meter.read()
    share = (time.process_time() - used_s) / (time.monotonic() - begun_s)
    assert cost.core_share == pytest.approx(share, rel=0.1)
    assert cost.memory_mb > 5


def test_sleeps_that_end_when_they_are_due_are_asked_of_the_system():
    """In a thread of its own: others of this process keep their slack."""
    slack_ns = []

    def ask():
        if not wake_on_time():
            return
        own = Path(f"/proc/{threading.get_native_id()}/timerslack_ns")
        slack_ns.append(int(own.read_text()) if own.exists() else 1)

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join(60.0)
    assert slack_ns in ([], [1])
    assert bool(slack_ns) == (sys.platform == "linux")


@ON_LINUX
def test_the_code_of_the_compiler_is_released_and_runs_again():
    printed_by(
        "-c",
        """
import numba, psutil
from mmt.core.running.process import release_compiler
memory_mb = lambda: psutil.Process().memory_info().rss / 1e6
double = numba.njit('f8(f8)')(lambda x: x + x)
before_mb = memory_mb()
assert release_compiler() > 0
assert release_compiler('no such library') == 0
assert memory_mb() < before_mb - 20.0
assert numba.njit('f8(f8)')(lambda x: double(x) + x)(1.0) == 3.0
""",
    )


def refuse(*_):
    raise PermissionError(1, "Operation not permitted")


def permitted():
    try:
        require_real_time()
    except MmtError:
        return False
    return True


def in_a_thread(function):
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(function).result(60.0)


@pytest.mark.skipif(not permitted(), reason=NOT_PERMITTED)
def test_the_thread_that_asks_is_real_time_and_what_it_starts_is_not():
    def ask():
        be_real_time()
        found = []
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


@pytest.mark.skipif(not permitted(), reason=NOT_PERMITTED)
def test_a_thread_may_follow_the_one_that_ticks(monkeypatch):
    monkeypatch.setattr(process, "_TICKS", threading.Event())

    def follow():
        follow_real_time()
        return os.sched_getscheduler(0)

    assert in_a_thread(follow) == os.SCHED_OTHER
    in_a_thread(be_real_time)
    assert in_a_thread(follow) == os.SCHED_FIFO | os.SCHED_RESET_ON_FORK


@ON_LINUX
def test_a_thread_that_may_not_follow_stays_an_ordinary_one(monkeypatch):
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    ticks = threading.Event()
    ticks.set()
    monkeypatch.setattr(process, "_TICKS", ticks)
    before = os.sched_getscheduler(0)
    follow_real_time()
    assert os.sched_getscheduler(0) == before


@ON_LINUX
def test_where_it_is_not_permitted_or_not_there_a_sentence_says_so(monkeypatch):
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    for function in (be_real_time, require_real_time):
        with pytest.raises(MmtError, match=r"not permitted .*rtprio 20.*LimitRTPRIO"):
            function()
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(MmtError, match="on Linux alone"):
        be_real_time()
