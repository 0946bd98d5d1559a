"""What this process costs: processor time, memory, and the settings that keep ticks even."""

import gc
import sys
import time
from dataclasses import dataclass

import psutil

SWITCH_INTERVAL_S = 1e-4
"""With the interpreter's default of 5 ms one busy thread would hold up every tick."""


def prefer_even_ticks() -> None:
    """Let the event loop's thread get the interpreter back soon, and keep collections short.

    Call once everything is imported and compiled: what exists then is never collected, so
    that the collector need not look at it again.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()


@dataclass(frozen=True)
class ProcessCost:
    """Share of one core since the meter was started, and the memory held now."""

    core_share: float
    memory_mb: float


class ProcessMeter:
    """Measure this process from now on."""

    def __init__(self) -> None:
        self._process = psutil.Process()
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
