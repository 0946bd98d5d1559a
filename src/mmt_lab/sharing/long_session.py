"""Long sessions with listeners that make trouble, and whether memory grows in them."""

import asyncio
import time
from typing import Final, Literal

import numpy as np
import psutil

from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.harness.findings import Findings
from mmt_lab.sharing.crowd import join_apart
from mmt_lab.sharing.session import run_with_listeners
from mmt_lab.sharing.troubled import EVERY_S, KINDS, STEADY, make_trouble
from mmt_lab.soak.drift import Drift, by_window, drift

_LARGEST_GROWTH_MB: Final = 1.0
_SAMPLE_S: Final = 1.0
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
        self._due_s = now_s + _SAMPLE_S
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


def run_long_session(duration_s: float, seed: int) -> Findings:
    """Run a long session with listeners that make trouble, and one without any."""
    alone_s = min(60.0, duration_s)
    alone, _ = asyncio.run(run_with_listeners(alone_s, (join_apart, 1), 1))
    memory = Memory()
    troubled = (make_trouble, seed)
    leader, found = asyncio.run(run_with_listeners(duration_s, troubled, STEADY, memory.sample))
    sharing = leader["sharing"]
    rows: dict[str, Figure] = {
        "tick_p99_ratio": (
            "leader's tick, p99, over that with one quiet listener",
            leader["ticks"]["period_p99_ms"] / alone["ticks"]["period_p99_ms"],
            "at most",
            1.1,
        ),
        "frames_lost": ("frames that the leader lost", leader["link"]["lost"], "at most", 0),
        "completed": ("the session completed", leader["outcome"] == "completed", "at least", 1),
        "steady": ("steady listeners with the last state", found["steady"], "at least", STEADY),
        "joined": ("listeners that joined", sharing["joined"]),
        **{kind: (text, found[kind]) for kind, text in KINDS.items()},
    }
    for who in ("leader", "sharing"):
        grown = memory.growth(who)
        rows[f"{who}_mb"] = (f"memory of the {who} process (MB)", grown.typical)
        rows[f"{who}_growth_mb"] = (
            f"its growth, lower end of 95 % (MB in {grown.span_s:.0f} s)",
            grown.least_growth,
            "at most",
            _LARGEST_GROWTH_MB,
        )
        slope = None if grown.growth is None else 3600.0 * grown.growth / grown.span_s
        rows[f"{who}_slope_mb_h"] = (f"slope of the {who} process (MB/h)", slope)
    about = (
        f"A rough texture for {duration_s / 60.0:g} min, {STEADY} listeners that stay, and others "
        f"that make trouble every {EVERY_S:g} s; memory after the first 30 %."
    )
    return single_figures("Sharing for long", about, rows)
