"""Cost of sharing a model, and how soon listeners have it.

Leader and follower run as processes with a rough texture, first with one listener and then with
many, all on this machine. Listeners join within one second when the model is ready, receive each of
its changes, and render nothing. The time to the first model includes the time to build one model.
Ticks are compared within a pair of sessions; the median over several pairs counts.
"""

import asyncio
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Annotated, Any, Final

import numpy as np
import typer

from mmt.core.errors import InputError, MmtError
from mmt.core.extras import require
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.harness.findings import Findings
from mmt_lab.sharing.counting import ListenerCounts
from mmt_lab.sharing.hubs import findings
from mmt_lab.sharing.session import run_with_listeners

SHOWS: Final = "what it costs to share a model, and how soon a hundred listeners have it"
TAKES: Final = "3 min"

CHANGES: Final = "changes to each while modelling (bytes/s)"
LAG: Final = "from the leader's state to the listener's, p50 (ms)"


def run(
    duration: Annotated[float, typer.Option(help="Seconds of each session.")] = 18.0,
    listeners: Annotated[int, typer.Option(min=2, help="How many join at once.")] = 100,
    pairs: Annotated[
        int | None,
        typer.Option(min=1, max=99, help="Sessions with one and with many, by turns; 3 if absent."),
    ] = None,
    hubs: Annotated[
        int | None,
        typer.Option(min=1, max=64, help="Share through so many hubs; needs redis-server."),
    ] = None,
) -> Findings:
    """Share a model with one listener, and with many who join at once."""
    if hubs is not None:
        if pairs is not None:
            raise InputError("--pairs does not go with --hubs: leave one of them out")
        require("redis")
        return findings(hubs, listeners, duration)
    ratios: list[float] = []
    pairs = 3 if pairs is None else pairs
    for _ in range(pairs):
        one, _ = asyncio.run(run_with_listeners(duration, 1))
        leader, found = asyncio.run(run_with_listeners(duration, listeners))
        ratios.append(leader["ticks"]["period_p99_ms"] / one["ticks"]["period_p99_ms"])
    ticks = "leader's tick, p99, over that with one listener"
    rows: dict[str, Figure] = {
        "tick_p99_ratio": (ticks, median(ratios), "at most", 1.1),
        "tick_p99_ratio_least": ("the same of the pair with the least", min(ratios)),
        "tick_p99_ratio_most": ("the same of the pair with the most", max(ratios)),
        **_of_the_crowd(leader, found, duration),
    }
    about = (
        f"A rough texture for {duration:g} s, one listener and then {listeners}; pairs: {pairs}, "
        "their ticks by the median, the rest of the last. After the model is complete nothing of "
        "it is sent."
    )
    return single_figures("Sharing", about, rows)


def _of_the_crowd(
    leader: Mapping[str, Any], found: Sequence[ListenerCounts], duration_s: float
) -> dict[str, Figure]:
    """Return what many listeners received in a session of the leader, and how late."""
    sent, models = leader["sharing"]["sent"], leader["sharing"]["models"]
    firsts = [each.first_s for each in found if each.first_s is not None]
    lags = [lag for each in found for lag in each.lags_ms]
    if not firsts or not lags or not sent["changes"]:
        problems = {each.problem for each in found} - {""}
        raise MmtError(f"no listener had a model and a change of it: {' '.join(problems)}")
    behind = sum(each.number != models for each in found)
    rejected = sum(each.rejected for each in found)
    whole = sent["wholes_bytes"] / sent["wholes"]
    changes = sent["changes_bytes"] / sent["changes"]
    changes *= models / (leader["texture"]["stop_s"] or duration_s)
    first_50, first_99 = np.percentile(firsts, [50, 99]).tolist()
    lag_50, lag_99 = np.percentile(lags, [50, 99]).tolist()
    return {
        "joined": ("listeners who had the model", len(firsts), "at least", len(found)),
        "behind": ("listeners without the last state", behind, "at most", 0),
        "rejected": ("messages that did not fit", rejected, "at most", 0),
        "model_bytes": ("whole model, on joining (bytes)", whole),
        "change_bytes_a_second": (CHANGES, changes, "at most", 2000),
        "first_p50_s": ("from connecting to a built model, p50 (s)", first_50, "at most", 0.3),
        "first_p99_s": ("from connecting to a built model, p99 (s)", first_99, "at most", 1.0),
        "lag_p50_ms": (LAG, lag_50, "at most", 50),
        "lag_p99_ms": ("the same, p99 (ms)", lag_99, "at most", 200),
    }
