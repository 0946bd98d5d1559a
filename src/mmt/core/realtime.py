"""Real-time scheduling of the ticking thread, if the system permits it.

A thread under ``SCHED_FIFO`` runs as soon as it wakes, before all ordinary work of the machine.
Only the ticking thread gets it, and threads that read data for the tick (`follow_real_time`).
Threads and processes that these start keep ordinary scheduling.
"""

import contextlib
import os
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from mmt.core.errors import MmtError

PRIORITY: Final = 20
"""Above all ordinary work; below the kernel's interrupt threads, which have 50."""

_HOW_TO_PERMIT: Final = (
    f"allow your user priority {PRIORITY} (a line 'USER - rtprio {PRIORITY}' in "
    "/etc/security/limits.conf and a new login, LimitRTPRIO= in a systemd unit, --cap-add SYS_NICE "
    "for a container), or leave --realtime out"
)


_TICKS: Final = threading.Event()
"""Set once a thread of this process ticks in real time."""


def be_real_time() -> None:
    """Schedule the calling thread in real time, ahead of all ordinary work.

    Raises
    ------
    MmtError
        The system lacks this scheduling or does not permit it; the message says how to permit it.
    """
    _schedule()
    _TICKS.set()


def ticks_in_real_time() -> bool:
    """Return whether a thread of this process has called `be_real_time`."""
    return _TICKS.is_set()


def follow_real_time() -> None:
    """Schedule the calling thread, which reads data for the ticking thread, in real time as well.

    Do nothing if no thread of this process has called `be_real_time`, if the calling thread is
    scheduled in real time already, or if the system does not permit it.
    """
    if ticks_in_real_time() and os.sched_getscheduler(0) == os.SCHED_OTHER:
        with contextlib.suppress(MmtError):
            _schedule()


def _schedule() -> None:
    if sys.platform != "linux":
        raise MmtError("real-time scheduling is offered on Linux alone: leave --realtime out")
    this_thread = 0
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    try:
        os.sched_setscheduler(this_thread, policy, os.sched_param(PRIORITY))
    except OSError as error:
        raise MmtError(
            f"real-time scheduling is not permitted ({error.strerror}): {_HOW_TO_PERMIT}"
        ) from error


def require_real_time() -> None:
    """Check on a separate thread whether `be_real_time` works here.

    Raises
    ------
    MmtError
        As `be_real_time`.
    """
    with ThreadPoolExecutor(1) as pool:
        pool.submit(_schedule).result()
