"""The running process: its clock and its cost, and what keeps its ticks even.

A thread in real time (``SCHED_FIFO``) runs as soon as it wakes, before all ordinary work of the
machine. If asked, the ticking thread gets it, and threads that read data for the tick
(`follow_real_time`). Threads and processes that these start keep ordinary scheduling.
"""

import ctypes
import functools
import gc
import os
import platform
import struct
import sys
import threading
import time
import uuid
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import psutil

from mmt.core.errors import MmtError

SWITCH_INTERVAL_S = 1e-4
"""Thread switch interval; with Python's default of 5 ms one busy thread would delay each tick."""

PRIORITY: Final = 20
"""Above all ordinary work; below the kernel's interrupt threads, which have 50."""

_HOW_TO_PERMIT: Final = (
    f"allow your user priority {PRIORITY} (a line 'USER - rtprio {PRIORITY}' in "
    "/etc/security/limits.conf and a new login, LimitRTPRIO= in a systemd unit, --cap-add SYS_NICE "
    "for a container), or leave --realtime out"
)

_TICKS: Final = threading.Event()
"""Set once a thread of this process ticks in real time."""

_SLICE_NS = 100_000
"""Scheduler time slice of the ticking thread; the kernel's default is about 3 ms."""

_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")
_OFFSETS: Final = Path("/proc/self/timens_offsets")

_MADV_DONTNEED = 4
_NICENESS = 5
_ATTEMPTS = 20
_PR_SET_TIMERSLACK = 29
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}
_ATTRIBUTES = "<IIQiIQQQ"  # struct sched_attr: size, policy, flags, nice, priority, runtime, ...


@functools.lru_cache(maxsize=1)
def clock_id() -> str:
    """Return a name for the clock that `time.monotonic_ns` reads here.

    Processes with equal names read the same clock, so that their times can be compared. On
    Linux the name consists of the boot, the host, and the offset of a time namespace, which
    containers may have; elsewhere the name is random and unique to the process.
    """
    try:
        boot = _BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return f"process-{uuid.uuid4()}"
    return f"{boot}@{platform.node()}{_namespace_offset()}"


def _namespace_offset() -> str:
    """Return the offset of the monotonic clock in a time namespace, "" without one."""
    try:
        lines = _OFFSETS.read_text(encoding="ascii").splitlines()
    except OSError:
        return ""
    for words in (line.split() for line in lines):
        if len(words) == 3 and words[0] == "monotonic" and words[1:] != ["0", "0"]:
            return f"+{words[1]}.{words[2]}"
    return ""


def ask_for_short_turns(slice_ns: int = _SLICE_NS) -> bool:
    """Ask the Linux scheduler for short time slices, so that this thread runs soon after waking.

    Since Linux 6.12 a thread of the ordinary policy may choose its time slice, and a thread
    with a shorter slice preempts one with a longer slice. This needs no privilege. Returns
    whether the kernel accepted the call; an older kernel leaves the slice as it was. A child
    process inherits the slice; 0 restores the kernel's default.
    """
    number = _SCHED_SETATTR.get(platform.machine())
    if sys.platform != "linux" or number is None or os.sched_getscheduler(0) != os.SCHED_OTHER:
        return False
    size = struct.calcsize(_ATTRIBUTES)
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    attributes = struct.pack(_ATTRIBUTES, size, os.SCHED_OTHER, 0, nice, 0, slice_ns, 0, 0)
    this_thread, no_flags = 0, 0
    return bool(ctypes.CDLL(None).syscall(number, this_thread, attributes, no_flags) == 0)


def wake_on_time() -> bool:
    """Make the sleeps of this thread, and of threads that it starts, end when they are due.

    By default Linux lets a sleep of the ordinary policy end up to 50 us late, to combine
    wake-ups. Returns whether the system accepted the call.
    """
    if sys.platform != "linux":
        return False
    return bool(ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0) == 0)


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
        with suppress(MmtError):
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


def prefer_even_ticks() -> None:
    """Prepare the process for even ticks: short time slices, short garbage collections.

    Call this on the event loop's thread once everything is imported and compiled. The collector
    skips all objects that exist then, and the memory of the compiler's code is released.
    """
    ask_for_short_turns()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()
    release_compiler()


def lower_priority() -> None:
    """Lower the priority of this process, which is the only one of its process session.

    If Linux groups processes by session, the group's niceness counts and is raised as well. Short
    time slices inherited from a ticking parent are given up: they would compete with the parent.
    """
    ask_for_short_turns(0)
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    for _ in range(_ATTEMPTS):
        try:
            Path("/proc/self/autogroup").write_text(str(_NICENESS), encoding="ascii")
        except BlockingIOError:  # the kernel takes one change in 0.1 s, from all processes
            time.sleep(0.1)
        except OSError:
            return
        else:
            return


def release_freed_memory() -> bool:
    """Return freed memory to the system; takes some ms.

    The C library of Linux keeps memory that was freed between longer-lived blocks: some MB after
    many connections with messages of all lengths. Returns whether the library has such a call.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is None:
        return False
    trim(ctypes.c_size_t(0))
    return True


def release_compiler(library: str = "libllvmlite") -> int:
    """Release the memory that holds the compiler's code and constants; what is used is read again.

    Little is used once kernels are loaded. These pages are equal to the file, so that nothing is
    lost. Returns the bytes of the mappings released, 0 if the library is not loaded or the system
    is not Linux.

    Parameters
    ----------
    library
        Part of the file's name.
    """
    mappings = []
    if sys.platform == "linux" and hasattr(psutil.Process, "memory_maps"):
        with suppress(psutil.Error):
            mappings = psutil.Process().memory_maps(grouped=False)
    released = 0
    for mapping in mappings:
        unchanged = mapping.anonymous == 0  # the loader has written nothing there
        if library in mapping.path and mapping.perms in {"r-xp", "r--p"} and unchanged:
            start, stop = (int(edge, 16) for edge in mapping.addr.split("-"))
            result = ctypes.CDLL(None).madvise(
                ctypes.c_void_p(start), ctypes.c_size_t(stop - start), _MADV_DONTNEED
            )
            released += stop - start if result == 0 else 0
    return released


@dataclass(frozen=True)
class ProcessCost:
    """Share of one core used since the meter was started, and the memory held now."""

    core_share: float
    memory_mb: float

    def as_dict(self) -> dict[str, float]:
        """Return the rounded values by name."""
        return {"core_share": round(self.core_share, 3), "memory_mb": round(self.memory_mb, 1)}


class ProcessMeter:
    """Measure the cost of a process from now on.

    Parameters
    ----------
    number
        Process identifier; None for this process.
    """

    def __init__(self, number: int | None = None) -> None:
        self._process = psutil.Process(number)
        self._wall_s = time.perf_counter()
        self._busy_s = self._busy()

    def read(self) -> ProcessCost:
        """Return the cost so far."""
        wall_s = max(time.perf_counter() - self._wall_s, 1e-9)
        return ProcessCost(
            core_share=(self._busy() - self._busy_s) / wall_s,
            memory_mb=self._process.memory_info().rss / 1e6,
        )

    def _busy(self) -> float:
        times = self._process.cpu_times()
        return float(times.user + times.system)
