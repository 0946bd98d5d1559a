"""Memory of a leader and of the process that serves its listeners, and whether it grows."""

import time
from typing import Final, Literal

import numpy as np
import psutil

from mmt_lab.soak.drift import Drift, by_window, drift

_EVERY_S: Final = 1.0
_SETTLED_SHARE: Final = 0.3
"""Share of the run that is ignored at first: the model still grows, and memory pools fill."""

Who = Literal["leader", "sharing"]


class Memory:
    """Samples of resident memory, one per second."""

    def __init__(self) -> None:
        self._seen: dict[Who, list[tuple[float, float]]] = {"leader": [], "sharing": []}
        self._due_s = 0.0

    def sample(self, pid: int) -> None:
        """Note the memory of the leader with this process id, and of its sharing process."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + _EVERY_S
        try:
            leader = psutil.Process(pid)
            self.add("leader", now_s, leader.memory_info().rss / 1e6)
            for child in leader.children():
                if "mmt_share.process" in child.cmdline():
                    self.add("sharing", now_s, child.memory_info().rss / 1e6)
        except psutil.Error:
            return  # the process has just ended

    def add(self, who: Who, time_s: float, memory_mb: float) -> None:
        """Note the memory of a process."""
        self._seen[who].append((time_s, memory_mb))

    def growth(self, who: Who) -> Drift:
        """Return the drift of a process's memory after the first 30 % of the run."""
        seen = np.array(self._seen[who]).reshape(-1, 2)
        times_s, values = seen[int(_SETTLED_SHARE * len(seen)) :].T
        window_s = max(1.0, np.ptp(times_s) / 20.0) if len(times_s) else 1.0
        return drift(*by_window(times_s, values, window_s, np.median))
