"""The faults of a soak: which, when and for how long, drawn from a seed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

CUT: Final = "connection cut"
STALL: Final = "connection stalled"
PAUSE_LEADER: Final = "leader paused"
PAUSE_FOLLOWER: Final = "follower paused"
RESTART: Final = "follower killed and started anew"
SLOW: Final = "slow network"

NETWORKS: Final[Mapping[str, Mapping[str, Any]]] = {
    SLOW: {"profile": "wan"},
    "losses in bursts": {"delay_ms": 3, "loss": 0.05, "burst_messages": 10},
    "bad network": {"profile": "bad"},
    "messages out of order and twice": {
        "delay_ms": 5,
        "jitter_ms": 5,
        "reorder": True,
        "duplicate": 0.05,
    },
    "silence": {"loss": 1.0},
}
"""Settings of the scene's ``[network]`` during a fault, by the name of the fault."""

LENGTHS_S: Final[Mapping[str, tuple[float, float]]] = {
    CUT: (0.0, 0.0),
    STALL: (0.05, 2.0),
    PAUSE_LEADER: (0.05, 1.5),
    PAUSE_FOLLOWER: (0.05, 1.5),
    RESTART: (0.2, 1.0),
    **dict.fromkeys(NETWORKS, (1.0, 8.0)),
}
"""Shortest and longest length of a fault, by kind; all kinds are here."""


@dataclass(frozen=True)
class SoakFault:
    """One fault: its kind, when it begins in seconds after the stream did, and its length."""

    kind: str
    at_s: float
    length_s: float

    @property
    def end_s(self) -> float:
        """When the fault is over."""
        return self.at_s + self.length_s


def plan_faults(duration_s: float, every_s: float, seed: int) -> tuple[SoakFault, ...]:
    """Draw the faults of a run, in order and without overlap.

    Every kind comes once before any comes again. Lengths are drawn evenly on a logarithmic
    scale, and are at most half of `every_s`. The follower is not started anew in the second
    half, so that its memory can be watched for long enough.

    Parameters
    ----------
    duration_s
        Duration of the run; the last fault ends at least `every_s` before the end of the run.
    every_s
        Mean time from a fault's end to the next one; each time is 0.5 to 1.5 times the mean.
    seed
        The same seed gives the same faults.
    """
    generator = np.random.default_rng(seed)
    faults: list[SoakFault] = []
    waiting: list[str] = []
    at_s = every_s
    while True:
        waiting = waiting or [str(kind) for kind in generator.permutation(list(LENGTHS_S))]
        kind = waiting.pop()
        shortest, longest = LENGTHS_S[kind]
        drawn = shortest * (longest / shortest) ** generator.uniform() if longest else 0.0
        fault = SoakFault(kind, at_s, min(drawn, 0.5 * every_s))
        if fault.end_s > duration_s - every_s:
            return tuple(faults)
        if kind == RESTART and at_s > 0.5 * duration_s:
            continue
        faults.append(fault)
        at_s = fault.end_s + every_s * generator.uniform(0.5, 1.5)
