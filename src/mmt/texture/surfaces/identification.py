"""Which of the known surfaces some blocks are of, if any."""

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
    evidence = {number: float(one.log_densities(blocks).sum()) for number, one in known.items()}
    first = max(evidence, key=lambda number: evidence[number])
    others = [evidence[number] for number in known if number != first]
    new = float(unknown.log_densities(blocks).sum()) + math.log(len(known))
    lead = evidence[first] - float(np.logaddexp.reduce([new, *others]))
    return (first if lead >= math.log(1.0 / WRONG - 1.0) else 0), lead
