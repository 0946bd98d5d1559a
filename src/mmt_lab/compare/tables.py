"""Tables, sentences and the figure of a comparison of methods."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise, product
from statistics import fmean
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from mmt.core.arrays import FloatArray
from mmt.core.output.palette import LIGHT
from mmt.evaluation.model_errors import PooledFigure, across, band_edges_hz, root_mean_square
from mmt.evaluation.reports.document import ReportTable
from mmt.evaluation.texts import number
from mmt_lab.compare.judging import FIGURES, SHARES, TIMES_S, Certainty, JudgedMethod
from mmt_lab.compare.summary import RUN_TO_RUN_DB, MethodComparison

DIGITS: Final = dict(zip(FIGURES, (2, 2, 2, 2, 3, 2, 2), strict=True))

TITLES: Final = dict(
    zip(
        FIGURES,
        (
            *("share, strokes", "share, plane", "level, strokes (dB)", "level, plane (dB)"),
            *("GFC", "spectrum (dB)", "bands (dB)"),
        ),
        strict=True,
    )
)

MAIN_ERRORS: Final = ("power_error_db", "plane_power_error_db", "log_spectral_db")
"""Errors that the tables show."""

TENTHS: Final = np.linspace(0.0, 1.0, 11)

LEAST_CASES: Final = 30
"""Least number of updates in a tenth of the expected share for that tenth to be judged."""


def shares_table(comparison: MethodComparison, name: str) -> ReportTable:
    """Return the shares of a texture or group, a row for each moment and method."""
    rows = []
    for row in comparison.rows(name):
        shares = [_cell(figure, row.figures.get(figure)) for figure in SHARES]
        met = f"{row.figures[SHARES[0]].sessions} of {row.sessions}"
        rows.append(
            [row.moment, row.method, met, number(row.time_s, 1), f"{row.samples:.0f}", *shares]
        )
    columns = ["moment", "method", "met", "time (s)", "samples", *(TITLES[s] for s in SHARES)]
    caption = (
        f"{name}: share within one JND over the strokes that were made and over the "
        "plane; median / mean / mean of the five worst / sessions below 0.5."
    )
    return ReportTable(columns, rows, caption)


def errors_table(comparison: MethodComparison, name: str) -> ReportTable:
    """Return some errors of a texture or group, a row for each moment and method."""
    rows = []
    for row in comparison.rows(name):
        bands = row.figures.get("band_error_db")
        cells = [_cell(figure, row.figures.get(figure)) for figure in MAIN_ERRORS]
        times = None if bands is None else bands.median / RUN_TO_RUN_DB
        rows.append([row.moment, row.method, *cells, number(times, 1)])
    columns = ["moment", "method", *(TITLES[figure] for figure in MAIN_ERRORS), "times run-to-run"]
    caption = (
        f"{name}: errors; median / mean / mean of the five worst. Last: the median error by bands "
        f"over {RUN_TO_RUN_DB} dB, by which one real surface differs from run to run."
    )
    return ReportTable(columns, rows, caption)


def rates_table(comparison: MethodComparison) -> ReportTable:
    """Return the errors at each rate of the acceleration, at the last moment, over all textures."""
    last = f"{TIMES_S[-1]:g} s"
    chosen = [one for one in comparison.judged if (one.moment, one.spoil) == (last, "")]
    rows = []
    for rate_hz, method in product(
        dict.fromkeys(one.acceleration_rate_hz for one in chosen), comparison.methods
    ):
        own = [o for o in chosen if (o.acceleration_rate_hz, o.method) == (rate_hz, method)]
        modelled = np.array([one.bands_db for one in own if one.bands_db])
        if not len(modelled):
            continue
        edges_hz = band_edges_hz(float(rate_hz))
        middles_hz = np.sqrt(edges_hz[1:] * edges_hz[:-1])
        cells = []
        for low_hz, high_hz in pairwise((0.0, 500.0, 1000.0, np.inf)):
            inside = modelled[:, (middles_hz >= low_hz) & (middles_hz < high_hz)]
            cells.append(number(root_mean_square(inside) if inside.size else None, 2))
        lacking: dict[str, list[float]] = {}
        for one in own:
            lacking.setdefault(one.texture, []).append(one.above_500_hz)
        missing = across(map(fmean, lacking.values()), larger_is_better=False)
        share = float(np.mean([one.figures[SHARES[0]] for one in own]))
        parts = (number(100.0 * value, 1) for value in (missing.mean, missing.worst))
        rows.append([f"{rate_hz / 1000:g}", method, *cells, number(share, 3), " / ".join(parts)])
    columns = ["kHz", "method", "to 500 Hz (dB)", "to 1000 Hz (dB)", "above (dB)"]
    caption = (
        f"By the rate of the acceleration, at {last}: error of the power in bands, root mean "
        "square over bands, strokes made and sessions; mean share of these strokes within one JND "
        "up to 1 kHz; share of the power above 500 Hz, which 1 kHz leaves out: mean over textures "
        "/ mean of the five largest. A band counts where its middle is."
    )
    return ReportTable([*columns, TITLES[SHARES[0]], "above 500 Hz (%)"], rows, caption)


def falls_table(comparison: MethodComparison) -> ReportTable:
    """Return the falls of the shares when sessions are spoilt."""
    rows = [
        [
            fall.spoil,
            fall.method,
            TITLES[fall.figure].removeprefix("share, "),
            *(number(value, 3) for value in (fall.before, fall.after, fall.mean)),
            *(number(value, 3) for value in (fall.percentile_95, fall.most)),
            number(fall.samples, 1),
        ]
        for fall in comparison.falls()
    ]
    columns = ["spoilt by", "method", "over", "before", "after", "fall", "95 %", "most", "samples"]
    caption = (
        "Mean share within one JND at 30 s of the same sessions before and after, and the fall: "
        "its mean, 95th percentile and largest."
    )
    return ReportTable(columns, rows, caption)


def calibration_table(comparison: MethodComparison, method: str) -> ReportTable:
    """Return true shares by expected ones: over all updates, and when the criteria were met."""
    rows = []
    expected, true = shares(comparison.sure.get(method, []))
    for low, high in pairwise(TENTHS):
        last = high == TENTHS[-1]
        inside = (expected >= low) & ((expected < high) | last)
        if inside.any():
            rows.append([f"{low:.1f} to {high:.1f}", *_calibrated(expected[inside], true[inside])])
    for moment in ("start", "stop"):
        met = list(_certain(comparison, method, moment))
        if met:
            pairs = np.array([(one.expected, one.true) for one in met], dtype=np.float64)
            rows.append([f"at the {moment}", *_calibrated(*pairs.T)])
    ratios = [one.standardised for one in _certain(comparison, method, "30 s")]
    caption = (
        f"{method}: true share by the expected one, over "
        "all updates and at the thresholds. Standardised error at 30 s, root mean square: "
        f"{number(root_mean_square(np.array(ratios, np.float64)) if ratios else None, 2)}."
    )
    columns = ["expected share", "cases", "expected, mean", "true, mean", "true - expected"]
    return ReportTable(columns, rows, caption)


def _calibrated(expected: FloatArray, true: FloatArray) -> list[str]:
    off = float(true.mean() - expected.mean())
    means = number(float(expected.mean()), 3), number(float(true.mean()), 3)
    return [str(len(expected)), *means, f"{off:+.3f}"]


def _certain(comparison: MethodComparison, method: str, moment: str) -> Iterator[JudgedMethod]:
    for one in comparison.judged:
        same = (one.method, one.spoil, one.moment) == (method, "", moment)
        if same and one.expected is not None:
            yield one


def shares(certainties: Sequence[Certainty]) -> tuple[FloatArray, FloatArray]:
    """Return the expected and the true share of every update, each (k,)."""
    rows = [update[1:] for one in certainties for update in one.updates]
    expected, true = np.reshape(rows, (-1, 2)).T
    return expected, true


def largest_miscalibration(certainties: Sequence[Certainty]) -> float | None:
    """Return the largest difference of true and expected share in a tenth with enough cases."""
    return max((abs(true - expected) for expected, true in tenths(certainties)), default=None)


def tenths(certainties: Sequence[Certainty]) -> list[tuple[float, float]]:
    """Return the mean expected and true share of each tenth that has enough cases."""
    expected, true = shares(certainties)
    tenth = np.clip(np.digitize(expected, TENTHS) - 1, 0, len(TENTHS) - 2)
    return [
        (float(expected[tenth == number].mean()), float(true[tenth == number].mean()))
        for number in range(len(TENTHS) - 1)
        if np.count_nonzero(tenth == number) >= LEAST_CASES
    ]


def difference_sentences(comparison: MethodComparison, method: str) -> list[str]:
    """Return for each group how much a method's share differs from that of the first one."""
    sentences = []
    for group in comparison.groups:
        found = []
        for each in comparison.differences(group):
            if (each.method, each.figure) == (method, SHARES[0]):
                error = each.standard_error
                around = f" ± {error:.3f}" if math.isfinite(error) else " (one pair)"
                found.append(f"{each.mean:+.3f}{around} at {each.moment} ({each.verdict})")
        if found:
            sentences.append(
                f"{group}: share of {method} over the strokes that were made, less that of "
                f"{comparison.methods[0]}: {', '.join(found)}."
            )
    return sentences


def calibration_figure(certainties: Sequence[Certainty]) -> Figure:
    """Draw the true share of every update over the expected one, and the means of tenths."""
    groups = list(dict.fromkeys(one.group for one in certainties))
    figure = Figure(figsize=(3.7 * len(groups) + 0.4, 3.8), layout="constrained")
    axes = figure.subplots(1, len(groups), sharey=True, squeeze=False)[0]
    for axis, group in zip(axes, groups, strict=True):
        own = [one for one in certainties if one.group == group]
        axis.plot((0, 1), (0, 1), color=LIGHT["faint"], linewidth=1.0)
        axis.scatter(*shares(own), s=7, color=LIGHT["streamed"], alpha=0.25, linewidth=0)
        if means := tenths(own):
            axis.plot(
                *np.array(means).T, color=LIGHT["ink"], marker="o", markersize=4, linewidth=1.2
            )
        axis.set(xlim=(0, 1.02), ylim=(0, 1.02), aspect="equal", title=group)
        axis.set_xlabel("expected share within one JND")
    axes[0].set_ylabel("true share")
    return figure


def _cell(figure: str, found: PooledFigure | None) -> str:
    if found is None:
        return "-"
    values = [number(value, DIGITS[figure]) for value in (found.median, found.mean, found.worst)]
    return " / ".join([*values, str(found.below_half)] if figure in SHARES else values)
