"""A time limit on calls of external code."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

from mmt_methods.generators.guarded import GeneratorFault

_AGAIN_S: Final = 1.0


class _Expired(BaseException):
    """Raised inside code that takes too long; not an `Exception`, which that code may catch."""


@contextmanager
def time_limit(seconds: float, fault: str) -> Iterator[None]:
    """Interrupt a block of Python code that takes too long, and raise `GeneratorFault`.

    A call into compiled code is not interrupted, but ends first. Without ``SIGALRM``, or outside
    the main thread, the block runs to its end, and the fault is raised then.
    """
    started = time.monotonic()
    if not (hasattr(signal, "SIGALRM") and threading.current_thread() is threading.main_thread()):
        yield
        if time.monotonic() - started > seconds:
            raise GeneratorFault(fault)
        return
    handler = signal.signal(signal.SIGALRM, _expire)
    left_s, interval_s = signal.setitimer(signal.ITIMER_REAL, seconds, _AGAIN_S)
    try:
        yield
    except _Expired as error:
        raise GeneratorFault(fault) from error
    finally:
        # Restore a timer that ran before, such as that of a test's own limit.
        rest_s = max(1e-3, left_s - (time.monotonic() - started)) if left_s else 0.0
        signal.signal(signal.SIGALRM, handler)
        signal.setitimer(signal.ITIMER_REAL, rest_s, interval_s)


def _expire(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - as signal calls it
    raise _Expired
