"""Sessions whose listeners are behind a network, or make trouble for long."""

import asyncio
from typing import Final

import numpy as np

from mmt.core.errors import MmtError
from mmt.evaluation.levels import root_mean_square
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.harness.findings import Findings
from mmt_lab.sharing.memory import Memory
from mmt_lab.sharing.session import listened_to
from mmt_lab.sharing.troubled import EVERY_S, KINDS, STEADY

_DISTANT: Final = 10
_LARGEST_GROWTH_MB: Final = 1.0


def behind_network(network: str, duration_s: float) -> Findings:
    """Compare what listeners behind a network feel with what the operator feels."""
    listeners = ("felt", str(_DISTANT), network)
    leader, found = asyncio.run(listened_to(duration_s, listeners, _DISTANT + 1))
    errors, lags = np.array(found["errors_db"]), found["lags_ms"]
    if not len(errors) or not lags:
        raise MmtError("no listener behind the network had a model and a change of it")
    lag_50, lag_99 = np.percentile(lags, [50, 99])
    rows: dict[str, Figure] = {
        "listeners": ("listeners who had the model", found["listeners"], "at least", _DISTANT),
        "error_db": (
            "felt against the operator's, rms over bands, motion and time (dB)",
            root_mean_square(errors),
            "at most",
            0.1,
        ),
        "delay_error_db": (
            "the same of one who has each change as soon as the delay allows (dB)",
            root_mean_square(np.array(found["delay_errors_db"])),
        ),
        "error_99_db": (
            "the same of the worst hundredth of the time (dB)",
            float(np.quantile(errors, 0.99)),
        ),
        "same_share": ("share of the time with the operator's very model", found["same_share"]),
        "behind": ("listeners without the last state", found["behind_at_end"], "at most", 0),
        "lag_p50_ms": ("from the leader's state to the listener's, p50 (ms)", lag_50),
        "lag_p99_ms": ("the same, p99 (ms)", lag_99),
        "repeated": ("packets lost and sent again", found["repeated"]),
        "wholes": ("whole models to each", found["wholes"] / _DISTANT),
        "frames_lost": ("frames that the leader lost", leader["link"]["lost"], "at most", 0),
    }
    about = (
        f"A rough texture for {duration_s:g} s, {_DISTANT} listeners behind the network profile "
        f"{network}; from each one's first model to the end, every 50 ms."
    )
    return single_figures("Listeners behind a network", about, rows)


def lasting(duration_s: float, seed: int) -> Findings:
    """Run a long session with listeners that make trouble, and one without any."""
    alone_s = min(60.0, duration_s)
    alone, _ = asyncio.run(listened_to(alone_s, ("crowd", "1"), 1))
    memory = Memory()
    troubled = ("troubled", str(seed))
    leader, found = asyncio.run(listened_to(duration_s, troubled, STEADY, memory.look))
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
