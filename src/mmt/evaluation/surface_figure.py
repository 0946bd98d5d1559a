"""Which surface the tool was found on, over session time."""

from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from mmt.evaluation.figures import COLOURS
from mmt.evaluation.recorded_surfaces import SurfaceParts


def surfaces_over_time(parts: SurfaceParts, duration_s: float) -> Figure:
    """Draw every stay as found, before the known textures that were under the tool."""
    figure = Figure(figsize=(8.4, 2.9), layout="constrained")
    axis = figure.subplots()
    if parts.course is not None and parts.truth is not None:
        truth = parts.truth
        edges = [0, *(np.flatnonzero(np.diff(truth)) + 1).tolist(), len(truth)]
        scale = duration_s / len(truth)
        for start, stop in pairwise(edges):
            place = int(truth[start])
            name = parts.course.surfaces[place].name
            seen = any(handle.get_label() == name for handle in axis.patches)
            axis.axvspan(
                start * scale,
                stop * scale,
                color=COLOURS[place % len(COLOURS)],
                alpha=0.22,
                linewidth=0,
                label="_" if seen else name,
            )
    for stay in parts.stays:
        axis.plot(
            [stay.from_s, stay.to_s],
            [stay.surface] * 2,
            color="#22262b",
            linewidth=3.0,
            solid_capstyle="butt",
        )
        if stay.found_s is not None:
            axis.plot(stay.found_s, stay.surface, "v", color="#22262b", markersize=7)
    axis.plot([], [], color="#22262b", linewidth=3.0, label="found")
    axis.plot([], [], "v", color="#22262b", label="from here on known")
    numbers = sorted(parts.sessions)
    axis.set_yticks(numbers, [f"surface {number}" for number in numbers])
    axis.set_ylim(max(numbers) + 0.6, min(numbers) - 0.6)
    axis.set_xlim(0, duration_s)
    axis.set_xlabel("session time (s)")
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=6, frameon=False, fontsize=9)
    return figure
