"""Long sessions with listeners that make trouble."""

import asyncio
from typing import Final

from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.harness.findings import Findings
from mmt_lab.sharing.crowd import join_apart
from mmt_lab.sharing.memory import Memory
from mmt_lab.sharing.session import run_with_listeners
from mmt_lab.sharing.troubled import EVERY_S, KINDS, STEADY, make_trouble

_LARGEST_GROWTH_MB: Final = 1.0


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
