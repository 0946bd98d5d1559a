"""Thresholds and calibration over sessions, as tables, sentences and a figure's data."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from mmt.core.arrays import BoolArray, FloatArray
from mmt.evaluation.document import Table
from mmt.evaluation.texts import number
from mmt_lab.compare.certainty import DEVIATIONS_DB, Certainty, Outcome, Update

SHARES: Final = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0)
"""Edges of the bands of expected shares."""

DEFINITIONS: Final = {
    "expected": "share of strokes whose level is expected to be within one JND, from the level's "
    "posterior, weighted by the operator's motion up to then",
    "true": "share of the same strokes, with the same weights, whose level is within "
    "one JND of the known texture's",
    "to come": "the same, weighted by the operator's motion from then to the session's end",
    "even": "share of the evaluation's grid",
    "standardised error": "root mean square of the level's error over its predicted standard "
    "deviation, over all updates: 1 where deviations are right, larger where they are too small",
}


def criteria_table(certainties: Sequence[Certainty], caption: str) -> Table:
    """Return what time the thresholds take, and what error they leave."""
    rows = []
    for threshold in ("start", "stop"):
        every = [_outcome(one, threshold) for one in certainties]
        met = [outcome for outcome in every if outcome.time_s is not None]
        rows.append(
            [
                threshold,
                f"{len(met)} of {len(every)}",
                _median(met, "time_s", 1),
                *(_median(met, name, 2) for name in ("samples", "expected", "weighted")),
                *(_median(met, name, 2) for name in ("to_come", "within_jnd")),
                _median(met, "gfc", 3),
                _median(met, "log_spectral_db", 2),
            ]
        )
    columns = ["at", "met", "time (s)", "samples", "expected", "true"]
    columns += ["to come", "even", "GFC", "spectrum (dB)"]
    return Table(columns, rows, caption)


def calibration_table(certainties: Sequence[Certainty], caption: str) -> Table:
    """Return the true share by the expected one, over all updates of all sessions."""
    expected, true = shares(certainties)
    rows = []
    for low, high in pairwise(SHARES):
        chosen = _in_band(expected, low, high)
        if not chosen.any():
            continue
        spread = np.percentile(true[chosen], (10.0, 90.0))
        rows.append(
            [
                f"{low:g} to {high:g}",
                str(int(chosen.sum())),
                number(float(expected[chosen].mean()), 3),
                number(float(true[chosen].mean()), 3),
                f"{spread[0]:.2f}-{spread[1]:.2f}",
            ]
        )
    columns = ["expected share", "updates", "expected, mean", "true, mean", "true, 10-90 %"]
    return Table(columns, rows, caption)


def deviation_table(certainties: Sequence[Certainty], caption: str) -> Table:
    """Return the standardised error by the predicted standard deviation, a row a texture."""
    names = list(dict.fromkeys(one.name for one in certainties))
    rows = []
    for name in [*names, "all"]:
        chosen = [one for one in certainties if name in {one.name, "all"}]
        squares = np.sum([one.squares for one in chosen], axis=0)
        counts = np.sum([one.counts for one in chosen], axis=0)
        bands = [
            "-" if count == 0 else f"{np.sqrt(square / count):.2f}"
            for square, count in zip(squares, counts, strict=True)
        ]
        total = "-" if counts.sum() == 0 else f"{np.sqrt(squares.sum() / counts.sum()):.2f}"
        rows.append([name, *bands, total])
    edges = [f"{low:g} to {high:g} dB" for low, high in pairwise(DEVIATIONS_DB[:-1])]
    return Table(["session", *edges, f"over {DEVIATIONS_DB[-2]:g} dB", "all"], rows, caption)


def shares(certainties: Sequence[Certainty]) -> tuple[FloatArray, FloatArray]:
    """Return expected and true shares, weighted, of all updates, each shape (k,)."""
    every: list[Update] = [update for one in certainties for update in one.updates]
    return (
        np.array([update.expected for update in every]),
        np.array([update.true for update in every]),
    )


def calibration_sentence(certainties: Sequence[Certainty], method: str) -> str:
    """Say how far expected and true shares are apart."""
    expected, true = shares(certainties)
    if not len(expected):
        return f"{method}: no model says how sure it is."
    off = true - expected
    return (
        f"{method}: over {len(off)} updates the true share, weighted by the operator's motion, is "
        f"the expected one {off.mean():+.3f}, root mean square {np.sqrt(np.mean(off**2)):.3f}."
    )


def _in_band(expected: FloatArray, low: float, high: float) -> BoolArray:
    """Whether shares (k,) are in a band, which has its lower edge, and the last one its upper."""
    return (expected >= low) & ((expected < high) | (high == SHARES[-1]))


def _outcome(one: Certainty, threshold: str) -> Outcome:
    return next(outcome for outcome in one.outcomes if outcome.threshold == threshold)


def _values(met: Sequence[Outcome], name: str) -> FloatArray:
    return np.array([value for one in met if (value := getattr(one, name)) is not None])


def _median(met: Sequence[Outcome], name: str, digits: int) -> str:
    values = _values(met, name)
    digits = 0 if name == "samples" else digits
    return number(float(np.median(values)) if len(values) else None, digits)


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
        bands = [_in_band(expected, low, high) for low, high in pairwise(SHARES)]
        means = [(expected[b].mean(), true[b].mean()) for b in bands if b.sum() >= _LEAST]
        if means:
            axis.plot(*np.array(means).T, color="black", marker="o", markersize=4, linewidth=1.2)
        axis.set(xlim=(0, 1.02), ylim=(0, 1.02), aspect="equal", title=group)
        axis.set_xlabel("expected share within one JND")
    axes[0].set_ylabel("true share")
    return figure
