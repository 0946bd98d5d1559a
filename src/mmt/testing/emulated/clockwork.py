"""The thread that runs emulated devices at their due times."""

import threading
import time
from collections.abc import Callable
from typing import Final

Turn = Callable[[int], int]
"""Does the work due at a monotonic time (ns), and returns the next due time."""

_IDLE_NS: Final = 10_000_000


class Clockwork:
    """A thread that calls the turn of each device when it is due.

    A device has a clockwork of its own, or shares that of a lab: its thread wakes once for all
    devices, and none waits for another's interpreter lock.

    Parameters
    ----------
    grid_ns
        Wake only at multiples of this time; 1 for whenever something is due.
    """

    def __init__(self, grid_ns: int = 1) -> None:
        self._grid_ns = grid_ns
        self._due: dict[Turn, int] = {}
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def add(self, turn: Turn) -> None:
        """Call a device's turn from now on."""
        with self._lock:
            self._due[turn] = 0
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._run, name="emulated devices", daemon=True
                )
                self._thread.start()

    def remove(self, turn: Turn) -> None:
        """Stop calling a turn; the thread ends with the last one. Calling it twice is harmless."""
        with self._lock:
            self._due.pop(turn, None)
            thread = None if self._due else self._thread
        if thread is not None:
            thread.join()

    def _run(self) -> None:
        while True:
            with self._lock:
                if not self._due:
                    self._thread = None
                    return
                now_ns = time.monotonic_ns()
                for turn, due_ns in tuple(self._due.items()):
                    if due_ns <= now_ns:
                        self._due[turn] = turn(now_ns)
                next_ns = min(*self._due.values(), now_ns + _IDLE_NS)
            next_ns += -next_ns % self._grid_ns
            time.sleep(max(0, next_ns - time.monotonic_ns()) / 1e9)
