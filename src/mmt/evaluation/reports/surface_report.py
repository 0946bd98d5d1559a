"""The surfaces of a session in a report: a table and a drawing of the stays on them."""

from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from mmt.core.output.palette import LIGHT, SERIES
from mmt.evaluation.recorded_surfaces import SurfaceParts
from mmt.evaluation.reports.document import Block, Heading, Paragraph, ReportTable, table_of
from mmt.evaluation.reports.report_files import picture


def surface_blocks(parts: SurfaceParts, duration_s: float) -> list[Block]:
    """Return a report's section on the surfaces that the tool was on, and when."""
    caption = "Found: the surface that the leader took the tool to be on, by its number."
    if parts.course is not None:
        caption += " Shade: the known texture that was under it."
    return [
        Heading("Surfaces"),
        Paragraph(account(parts)),
        stay_table(parts),
        picture("surfaces", caption, surfaces_over_time(parts, duration_s)),
    ]


def account(parts: SurfaceParts) -> str:
    """Return a sentence with the number of surfaces that were found."""
    found, stays = len(parts.sessions), len(parts.stays)
    sentence = f"{found} surface{'s' * (found != 1)} in {stays} stay{'s' * (stays != 1)}"
    if parts.truth is not None:
        sentence += f"; the tool was really on {len(set(parts.truth.tolist()))}"
    return (
        f"{sentence}. Each has a model of its own, which is evaluated below over the time that was "
        "spent on it, stay after stay."
    )


def stay_table(parts: SurfaceParts) -> ReportTable:
    """Return a row for each stay."""
    rows = [
        {
            "surface": str(stay.surface),
            "from (s)": f"{stay.from_s:.2f}",
            "to (s)": f"{stay.to_s:.2f}",
            "found at (s)": "" if stay.found_s is None else f"{stay.found_s:.2f}",
            **({} if parts.course is None else {"mostly on": stay.truth or ""}),
        }
        for stay in parts.stays
    ]
    return table_of(rows)


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
                color=SERIES[place % len(SERIES)],
                alpha=0.22,
                linewidth=0,
                label="_" if seen else name,
            )
    for stay in parts.stays:
        axis.plot(
            [stay.from_s, stay.to_s],
            [stay.surface] * 2,
            color=LIGHT["ink"],
            linewidth=3.0,
            solid_capstyle="butt",
        )
        if stay.found_s is not None:
            axis.plot(stay.found_s, stay.surface, "v", color=LIGHT["ink"], markersize=7)
    axis.plot([], [], color=LIGHT["ink"], linewidth=3.0, label="found")
    axis.plot([], [], "v", color=LIGHT["ink"], label="from here on known")
    numbers = sorted(parts.sessions)
    axis.set_yticks(numbers, [f"surface {number}" for number in numbers])
    axis.set_ylim(max(numbers) + 0.6, min(numbers) - 0.6)
    axis.set_xlim(0, duration_s)
    axis.set_xlabel("session time (s)")
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=6, frameon=False, fontsize=9)
    return figure
