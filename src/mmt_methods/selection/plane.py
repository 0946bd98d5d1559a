"""Plot of a selection: kept samples, redundant samples and outliers."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mmt.core.arrays import FloatArray
from mmt.core.palette import LIGHT
from mmt.texture.space.samples import TextureSamples
from mmt_methods.selection import Selection


def selection_plane(samples: TextureSamples, selection: Selection) -> Figure:
    """Draw kept and redundant samples and outliers, with a second panel if the heading counts."""
    directed = samples.space.directed
    figure = Figure(figsize=(9.6 if directed else 5.4, 4.0), layout="constrained")
    axes = figure.subplots(1, 2 if directed else 1, squeeze=False)[0]
    _scatter(axes[0], np.column_stack([samples.speed_mm_s, samples.force_n]), selection)
    axes[0].set(xlabel="speed (mm/s)", ylabel="normal force (N)")
    if directed:
        _scatter(axes[1], samples.inputs[:, :2], selection)
        axes[1].set(xlabel="velocity x (mm/s)", ylabel="velocity y (mm/s)", aspect="equal")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False, fontsize=8)
    return figure


def _scatter(axis: Axes, places: FloatArray, selection: Selection) -> None:
    for name, chosen, size, colour, marker in (
        ("redundant", selection.redundant, 12.0, LIGHT["known"], "o"),
        ("kept", selection.kept, 26.0, LIGHT["streamed"], "o"),
        ("outlier", selection.outlier, 34.0, LIGHT["synthesized"], "X"),
    ):
        axis.scatter(
            places[chosen, 0],
            places[chosen, 1],
            s=size,
            color=colour,
            marker=marker,
            label=f"{name} ({int(chosen.sum())})",
        )
