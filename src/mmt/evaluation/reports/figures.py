"""The figures of a report; every function returns a figure that is bound to no window."""

import io
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from PIL import Image

from mmt.core.arrays import FloatArray
from mmt.core.output.palette import LIGHT, SERIES, SIGNED
from mmt.evaluation.results import Evaluation, HeldOutSegment, Score
from mmt.texture.settings import JND_DB, MAXIMUM_FORCE_N, MAXIMUM_SPEED_MM_S, CriterionScale

_MARKERS: Final = "osD^vP"
_DOTS_PER_INCH: Final = 130
_NARROW_INCHES: Final = 4.2
_GREY: Final = LIGHT["faint"]
_MOST_DB: Final = 6.0


def to_png(figure: Figure) -> bytes:
    """Return a figure as PNG of 256 colours, which takes a third of the bytes of full colour."""
    few, canvas = io.BytesIO(), FigureCanvasAgg(figure)
    figure.set_dpi(_DOTS_PER_INCH)
    canvas.draw()  # type: ignore[no-untyped-call]
    image = Image.fromarray(np.asarray(canvas.buffer_rgba()))  # type: ignore[no-untyped-call]
    image.convert("RGB").quantize(dither=Image.Dither.NONE).save(few, format="png", optimize=True)
    return few.getvalue()


def stack_panels(figure: Figure) -> None:
    """Lay a figure out anew for a telephone: all panels in one column."""
    placed = [(axis, place) for axis in figure.axes if (place := axis.get_subplotspec())]
    grid = placed[0][1].get_gridspec()
    rows = len(placed)
    below = figure.add_gridspec(rows, 1)
    for number, (axis, _) in enumerate(placed):
        axis.set_subplotspec(below[number])
        axis.tick_params(labelleft=True, labelbottom=True)
    for legend in list(figure.legends):
        handles = [handle for handle in legend.legend_handles if handle is not None]
        texts = [text.get_text() for text in legend.get_texts()]
        legend.remove()
        figure.legend(
            handles, texts, loc="outside lower center", ncols=2, frameon=False, fontsize=8
        )
    width, height = figure.get_size_inches()
    height *= rows / grid.nrows  # of all panels
    if len(placed) < len(figure.axes):  # large at first: else colour bars do not find their place
        figure.set_size_inches(_NARROW_INCHES, 3.0 * height)
        figure.draw_without_rendering()
    figure.set_size_inches(_NARROW_INCHES, max(0.75, _NARROW_INCHES / width) * height)


def style_axes(axis: Axes) -> None:
    """Give axes the grid and the two spines that every plot has."""
    axis.grid(color=LIGHT["line"], linewidth=0.6)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)


def readiness() -> LinearSegmentedColormap:
    """Return the colour map of cells and of scores: the bluer, the better."""
    return LinearSegmentedColormap.from_list("readiness", (LIGHT["unready"], LIGHT["ready"]))


def completion_over_time(evaluations: Sequence[Evaluation]) -> Figure:
    """Draw the criterion's value after every update, a panel for each criterion with thresholds."""
    scales = list(dict.fromkeys(evaluation.settings.scale for evaluation in evaluations))
    figure, axes = _time_axes(evaluations, len(scales))
    for axis, scale in zip(axes, scales, strict=True):
        courses = {
            number: (evaluation.name, evaluation.course)
            for number, evaluation in enumerate(evaluations)
            if evaluation.settings.scale == scale
        }
        draw_course(axis, courses, scale)
    _legend(figure, evaluations)
    return figure


def draw_course(
    axis: Axes, courses: Mapping[int, tuple[str, FloatArray]], scale: CriterionScale
) -> None:
    """Draw name, time and value of a criterion (k, 2) by curve number, and both thresholds."""
    for number, (name, course) in courses.items():
        axis.plot(*course.T, label=name, **line_style(number))
    for value, text in ((scale.start, "start"), (scale.stop, "stop")):
        axis.axhline(value, color=_GREY, linestyle="--", linewidth=1.0)
        axis.annotate(
            f"{text}\n{value:.4g}",
            (1.0, value),  # outside, where no curve is
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            color=_GREY,
            fontsize=9,
        )
    largest = max(scale.start, *(float(course[:, 1].max()) for _, course in courses.values()))
    axis.set_ylim(0, 1.02 if scale.rises else min(1.05 * largest, 2.2 * scale.start))
    axis.set_ylabel("expected share" if scale.rises else "distance (sum over cells)")


def gfc_over_time(evaluations: Sequence[Evaluation]) -> Figure:
    """Draw the held-out GFC at every step, its ceiling, and 0.9, as paper A's Fig. 4 does."""
    figure, (axis,) = _time_axes(evaluations)
    for number, evaluation in enumerate(evaluations):
        time_s = [step.time_s for step in evaluation.steps]
        style = line_style(number)
        axis.plot(time_s, _column(evaluation.steps, "gfc"), label=evaluation.name, **style)
        axis.plot(
            time_s,
            _column(evaluation.steps, "gfc_ceiling"),
            color=style["color"],
            linestyle=":",
            linewidth=1.0,
        )
    axis.axhline(0.9, color=_GREY, linestyle="--", linewidth=1.0)
    axis.plot([], [], color=_GREY, linestyle=":", label="ceiling (model against itself)")
    lowest = min(
        (step.gfc for e in evaluations for step in e.steps if step.gfc is not None), default=0.8
    )
    axis.set_ylim(min(0.8, np.floor(lowest * 20) / 20), 1.0)
    axis.set_ylabel("GFC of held-out segments")
    _legend(figure, evaluations)
    return figure


def power_error_over_time(evaluations: Sequence[Evaluation]) -> Figure:
    """Draw the power error at every step beside the just noticeable difference."""
    figure, (axis,) = _time_axes(evaluations)
    draw_power_error(axis, evaluations)
    _legend(figure, evaluations)
    return figure


def draw_power_error(axis: Axes, evaluations: Sequence[Evaluation]) -> None:
    """Draw the power error of each evaluation at every step."""
    for number, evaluation in enumerate(evaluations):
        axis.plot(
            [step.time_s for step in evaluation.steps],
            _column(evaluation.steps, "power_error_db"),
            label=f"{evaluation.name} ({evaluation.basis})",
            **line_style(number),
        )
    axis.axhline(JND_DB, color=_GREY, linestyle="--", linewidth=1.0, label="just noticeable")
    axis.set_ylim(bottom=0)
    axis.set_ylabel("power error (dB rms)")


def held_out_spectra(evaluation: Evaluation) -> Figure:
    """Draw measured and synthesized spectra of the held-out segments (paper A, Fig. 5)."""
    segments = evaluation.held_out
    figure = Figure(figsize=(2.7 * len(segments) + 0.6, 3.3), layout="constrained")
    axes = figure.subplots(1, len(segments), sharey=True, squeeze=False)[0]
    for axis, segment in zip(axes, segments, strict=True):
        _draw_spectra(axis, segment)
    axes[0].set_ylabel("amplitude (m/s² per √Hz)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def power_error_map(evaluation: Evaluation) -> Figure:
    """Draw power error and GFC against the known texture over the plane."""
    errors = evaluation.power_map
    if errors is None:
        message = "a map needs a known texture and a model"
        raise ValueError(message)
    figure = Figure(figsize=(9.6, 3.9), layout="constrained")
    over = " rms over headings" if evaluation.by_heading else ""
    worst_gfc = min(0.9, float(errors.gfc.min()))
    panels = (
        (f"power error (dB{over})", errors.power_error_db, SIGNED, -_MOST_DB, _MOST_DB, "both"),
        ("GFC", errors.gfc, readiness(), worst_gfc, 1.0, "neither"),
    )
    axes = figure.subplots(1, 2, sharey=True)
    model = evaluation.model_at(evaluation.final.time_s)
    for axis, panel, worst in zip(axes, panels, evaluation.worst, strict=True):
        title, values, colours, least, most, extend = panel
        drawn = axis.pcolormesh(
            errors.speed_mm_s,
            errors.force_n,
            values,
            cmap=colours,
            vmin=least,
            vmax=most,
            shading="nearest",
        )
        figure.colorbar(drawn, ax=axis, extend=extend)
        axis.set_title(title, fontsize=10)
        if model is not None:
            places = model.samples.speed_mm_s, model.samples.force_n
            axis.scatter(*places, s=11, c=LIGHT["measured"], edgecolors=LIGHT["panel"], lw=0.5)
        place = worst.speed_mm_s, worst.force_n
        axis.plot(*place, "o", ms=15, mfc="none", mec=LIGHT["ink"], mew=1.2)
        axis.set(xlim=(0, MAXIMUM_SPEED_MM_S), ylim=(0, MAXIMUM_FORCE_N))
        axis.set_xlabel("speed (mm/s)")
    axes[0].set_ylabel("normal force (N)")
    return figure


def _draw_spectra(axis: Axes, segment: HeldOutSegment) -> None:
    if segment.truth is not None:
        known = LIGHT["known"]
        axis.semilogy(segment.truth, color=known, lw=3.0, label="known texture (exact)")
    for name, spectrum in (("measured", segment.measured), ("synthesized", segment.synthesized)):
        if spectrum is not None:
            # One-sided densities are halved at 0 and at half the rate: not drawn.
            inner = segment.frequencies_hz[1:-1], spectrum[1:-1]
            axis.semilogy(*inner, color=LIGHT[name], lw=1.7, label=name)
    score = "" if segment.gfc is None else f"\nGFC {segment.gfc:.3f}"
    axis.set_title(f"{segment.speed_mm_s:.0f} mm/s, {segment.force_n:.2f} N{score}", fontsize=9)
    axis.set_xlim(0.0, segment.frequencies_hz[-1])
    axis.set_xlabel("frequency (Hz)")
    style_axes(axis)


def _time_axes(evaluations: Sequence[Evaluation], rows: int = 1) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(8.4, 3.8 * rows), layout="constrained")
    axes = figure.subplots(rows, 1, squeeze=False).ravel().tolist()
    for axis in axes:
        axis.set_xlim(0, 1.02 * max(evaluation.duration_s for evaluation in evaluations))
        lay_out_time(axis)
    return figure, axes


def lay_out_time(axis: Axes) -> None:
    """Lay axes out for session time."""
    axis.set_xlabel("session time (s)")
    style_axes(axis)


def line_style(number: int) -> dict[str, Any]:
    """Return colour, marker and dashes of the curve of this number."""
    turn, place = divmod(number, len(SERIES))
    return {
        "color": SERIES[place],
        "marker": _MARKERS[place],
        "markersize": 4.5,
        "linewidth": 1.5,
        "linestyle": ("-", "--", "-.")[turn % 3],
    }


def _column(steps: Sequence[Score], name: str) -> list[float]:
    values = (getattr(step, name) for step in steps)
    return [np.nan if value is None else value for value in values]


def _legend(figure: Figure, evaluations: Sequence[Evaluation]) -> None:
    if len(evaluations) > 4:
        figure.legend(loc="outside right upper", frameon=False, fontsize=9)
        return
    for axis in figure.axes:
        axis.legend(frameon=False, fontsize=9)


def errors_by_heading(evaluation: Evaluation) -> Figure:
    """Draw GFC, log-spectral distance and power error against the heading, a line a model."""
    figure = Figure(figsize=(9.6, 3.3), layout="constrained")
    panels = (
        ("gfc", "GFC"),
        ("log_spectral_db", "log-spectral distance (dB)"),
        ("power_error_db", "power error (dB rms)"),
    )
    axes = figure.subplots(1, len(panels))
    for axis, (name, title) in zip(axes, panels, strict=True):
        for place, errors in enumerate(evaluation.by_heading):
            axis.plot(
                [sector.heading_deg for sector in errors.sectors],
                [getattr(sector, name) for sector in errors.sectors],
                label=errors.model,
                **line_style(place),
            )
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("heading (degrees)")
        axis.set(xlim=(0, 360), xticks=range(0, 361, 90))
        style_axes(axis)
        if name == "gfc":
            axis.set_ylim(top=1.0)
        else:
            axis.set_ylim(bottom=0.0)
    axes[-1].axhline(JND_DB, color=_GREY, linestyle="--", linewidth=1.0, label="just noticeable")
    handles, labels = axes[-1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure
