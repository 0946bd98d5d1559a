"""Which of the known surfaces some blocks are of, if any.

A known surface must be much likelier than all the others and an unknown one, and the bets that
would have raised an alarm on it must not speak against it: the likeliest of the known ones may
still be the wrong one.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.surface import KnownSurface

WRONG: Final = 0.002
"""Probability at which a known surface may be the wrong one."""


def recognised(
    unknown: KnownSurface, known: Mapping[int, KnownSurface], blocks: Sequence[SurfaceBlock]
) -> tuple[int, float]:
    """Return the number of the known surface that blocks are of, 0 where none is sure.

    And its lead: natural logarithm of the Bayes factor over all others and an unknown one, where
    that has half of the prior weight, and all known ones the other half.
    """
    if not known:
        return 0, 0.0
    against = float(unknown.judge(blocks)[1].sum()) + math.log(len(known))
    judged = {number: surface.judge(blocks) for number, surface in known.items()}
    evidence = {number: float(densities.sum()) for number, (_, densities) in judged.items()}
    first = max(evidence, key=lambda number: evidence[number])
    rest = np.logaddexp.reduce([against, *(e for n, e in evidence.items() if n != first)])
    lead = float(evidence[first] - rest)
    if lead < math.log(1.0 / WRONG - 1.0):
        return 0, lead
    innovations = judged[first][0]
    bets = [known[first].log_bet(innovations[:count]) for count in range(1, len(blocks) + 1)]
    # Bets from a given block on ever win 1 / p with a probability of p at most (Ville).
    return (first if _largest_win(bets) < math.log(len(blocks) / WRONG) else 0), lead


def _largest_win(log_bets: Sequence[float]) -> float:
    """Return the largest sum of bets in a row."""
    best = win = 0.0
    for bet in log_bets:
        win = max(win, 0.0) + bet
        best = max(best, win)
    return best
