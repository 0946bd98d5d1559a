"""Expected against true shares: the figure of how well a model knows its error."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from mmt_lab.methods.certainty import Certainty
from mmt_lab.methods.certainty_tables import SHARES, shares

_COLOURS: Final = ("#0072b2", "#d55e00", "#009e73")
_LEAST: Final = 10  # updates of a band that is drawn


def calibration_figure(certainties: Sequence[Certainty]) -> Figure:
    """Draw the true share of every update over the expected one, and means of bands."""
    groups = list(dict.fromkeys(one.group for one in certainties))
    figure = Figure(figsize=(3.7 * len(groups) + 0.4, 3.8), layout="constrained")
    axes = figure.subplots(1, len(groups), sharey=True, squeeze=False)[0]
    for axis, group, colour in zip(axes, groups, _COLOURS, strict=False):
        expected, true = shares([one for one in certainties if one.group == group])
        axis.plot((0, 1), (0, 1), color="#8a9099", linewidth=1.0)
        axis.scatter(expected, true, s=7, color=colour, alpha=0.25, linewidth=0)
        bands = [(expected >= low) & (expected <= high) for low, high in pairwise(SHARES)]
        means = [(expected[b].mean(), true[b].mean()) for b in bands if b.sum() >= _LEAST]
        if means:
            axis.plot(*np.array(means).T, color="black", marker="o", markersize=4, linewidth=1.2)
        axis.set(xlim=(0, 1.02), ylim=(0, 1.02), aspect="equal", title=group)
        axis.set_xlabel("expected share within one JND")
    axes[0].set_ylabel("true share")
    return figure
