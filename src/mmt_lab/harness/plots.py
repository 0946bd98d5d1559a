"""Plots of panels: every panel one pair of axes, every method one colour."""

import math
from collections.abc import Sequence
from textwrap import fill
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from mmt.core.arrays import FloatArray
from mmt.core.output.palette import LIGHT
from mmt.evaluation.reports.figures import line_style, style_axes
from mmt_lab.harness.findings import Axis as SideOfPanel
from mmt_lab.harness.findings import Curve, Findings, Panel, Point

_LEGEND_COLUMNS: Final = 3
_OURS: Final = "mmt"
_TITLE_LETTERS, _LABEL_LETTERS = 44, 30  # as wide and as high as a panel on a telephone
_LINEAR_SPAN: Final = 2.5
_PLAIN_SPAN: Final = 100.0
_LABEL_PIXELS: Final = (36.0, 14.0)
"""Labels that are closer than this in x and y would overlap."""


def panels_figure(result: Findings) -> Figure:
    """Draw all panels, with one legend."""
    count = len(result.panels)
    columns = 3 if count > 3 and count % 3 == 0 else min(2, count)
    rows = math.ceil(count / columns)
    width = 14.0 if columns == 3 else 5.2 * columns
    figure = Figure(figsize=(width, 3.7 * rows + 0.6), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    methods = list(dict.fromkeys(c.method for panel in result.panels for c in panel.curves))
    for axis, panel in zip(axes, result.panels, strict=False):
        _draw(axis, panel, methods)
    for axis in axes[count:]:
        axis.remove()
    handles = {
        label: handle
        for axis in figure.axes
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        handles.values(),
        handles.keys(),
        loc="outside lower center",
        ncols=min(_LEGEND_COLUMNS, len(handles)),
        frameon=False,
        fontsize=9,
    )
    return figure


def _draw(axis: Axes, panel: Panel, methods: Sequence[str]) -> None:
    floor = _floor(panel) if panel.y.logarithmic else -math.inf
    for curve in panel.curves:
        if curve.points:
            _draw_curve(axis, curve, methods.index(curve.method), floor)
    points = [point for curve in panel.curves for point in curve.points]
    across, along = [p.x.median for p in points], [p.y.median for p in points]
    if _is_logarithmic(panel.x, across):
        axis.set_xscale("log")
        _make_readable(axis.xaxis, across)
    if _is_logarithmic(panel.y, along):
        axis.set_yscale("log")
        _make_readable(axis.yaxis, along)
    else:
        axis.set_ylim(bottom=0.0)
    if not all(curve.over_knob for curve in panel.curves):
        _name_knob(axis, panel, floor)
    axis.set_title(fill(panel.title, _TITLE_LETTERS), fontsize=10)
    axis.set_xlabel(panel.x.label)
    axis.set_ylabel(fill(panel.y.label, _LABEL_LETTERS))
    style_axes(axis)


def _is_logarithmic(of: SideOfPanel, values: Sequence[float]) -> bool:
    return of.logarithmic and _span(values) > _LINEAR_SPAN


def _make_readable(axis: Axis, values: Sequence[float]) -> None:
    """Write plain numbers if values span too little for powers of ten."""
    if _span(values) < _PLAIN_SPAN:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
        axis.set_minor_locator(NullLocator())


def _span(values: Sequence[float]) -> float:
    positive = [value for value in values if value > 0.0]
    return max(positive) / min(positive) if positive else 1.0


def _draw_curve(axis: Axes, curve: Curve, number: int, floor: float) -> None:
    x = np.array([point.x.median for point in curve.points])
    y = np.array([max(point.y.median, floor) for point in curve.points])
    across = [[p.x.median - p.x.low, p.x.high - p.x.median] for p in curve.points]
    along = [[p.y.median - p.y.low, p.y.high - p.y.median] for p in curve.points]
    ours = curve.method.startswith(_OURS)
    axis.errorbar(
        x,
        y,
        xerr=np.transpose(across),
        yerr=np.transpose(along),
        label=curve.method,
        elinewidth=0.8,
        zorder=3 if ours else 2,
        **line_style(number) | {"linewidth": 2.0 if ours else 1.2},
    )


def _name_knob(axis: Axes, panel: Panel, floor: float) -> None:
    """Write the knob beside the ends of each curve, unless the label would cover another."""
    written: list[FloatArray] = []
    for curve in panel.curves:
        ends: list[Point] = list(curve.points[:1]) + list(curve.points[1:][-1:])
        for point in ends:
            there = point.x.median, max(point.y.median, floor)
            pixel = axis.transData.transform(there)
            if any((np.abs(pixel - other) < _LABEL_PIXELS).all() for other in written):
                continue
            written.append(pixel)
            axis.annotate(
                f"{point.knob:g}",
                there,
                xytext=(3, 4),
                textcoords="offset points",
                fontsize=7,
                color=LIGHT["faint"],
            )


def _floor(panel: Panel) -> float:
    """Return the value at which an error of zero is drawn on a logarithmic axis."""
    values = [point.y.median for curve in panel.curves for point in curve.points]
    positive = [value for value in values if value > 0.0]
    return 0.3 * min(positive) if positive else 1.0
