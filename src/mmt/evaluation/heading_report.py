"""Errors by heading as the blocks of a report."""

from matplotlib.figure import Figure

from mmt.evaluation import tables
from mmt.evaluation.document import Block
from mmt.evaluation.figures import COLOURS
from mmt.evaluation.report_files import picture
from mmt.evaluation.results import Evaluation
from mmt.texture.signals.metrics import JND_DB


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
                color=COLOURS[place],
                marker="osD"[place],
                markersize=4.5,
                label=errors.model,
            )
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("heading (degrees)")
        axis.set(xlim=(0, 360), xticks=range(0, 361, 90))
        axis.grid(color="#e3e6ea", linewidth=0.6)
        if name == "gfc":
            axis.set_ylim(top=1.0)
        else:
            axis.set_ylim(bottom=0.0)
    axes[-1].axhline(
        JND_DB, color="#8a9099", linestyle="--", linewidth=1.0, label="just noticeable"
    )
    handles, labels = axes[-1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def heading_blocks(evaluation: Evaluation, prefix: str) -> list[Block]:
    """Return what a report says by heading; nothing where the texture does not depend on it."""
    if not evaluation.by_heading:
        return []
    caption = f"Errors against the known texture by heading, at {evaluation.final.time_s:.1f} s."
    return [
        picture(f"{prefix}headings", caption, errors_by_heading(evaluation)),
        tables.by_heading(evaluation),
    ]
