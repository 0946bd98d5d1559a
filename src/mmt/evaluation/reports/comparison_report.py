"""The report of a comparison: headlines, both on one axis, settings, and all that differs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.errors import naming
from mmt.core.output.palette import LIGHT
from mmt.evaluation.reports.comparison import COLUMNS, Comparison
from mmt.evaluation.reports.document import (
    Block,
    Folded,
    Heading,
    Paragraph,
    Picture,
    ReportTable,
    SideBySide,
)
from mmt.evaluation.reports.report_files import FIGURES, picture, write_report_files
from mmt.texture.settings import JND_DB

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OVERLAID: Final = ("distance.png", "power_error.png", "gfc.png")
"""Pictures that show no more than the picture of both courses."""


def write_comparison(comparison: Comparison, directory: Path) -> Path:
    """Write a comparison as a report of its own; return the page.

    Raises
    ------
    InputError
        The directory cannot be written, or a picture cannot be read.
    """
    title = f"{comparison.left.name} and {comparison.right.name}"
    blocks: list[Block] = [
        Heading(title, 1),
        Paragraph(f"A is {comparison.left}, B is {comparison.right}. {comparison.verdict}"),
        *map(Paragraph, comparison.missing_parts),
    ]
    blocks += comparison.answers
    if comparison.steps:
        caption = "Both over session time; dashed: the just noticeable difference."
        blocks.append(picture("both", caption, both_over_time(comparison.steps)))
    sides = {"A": comparison.left, "B": comparison.right}
    pairs: list[Block] = []
    for name in comparison.pictures:
        if comparison.steps and name in _OVERLAID:
            continue
        shown = [_picture(letter, folder, name) for letter, folder in sides.items()]
        pairs.append(Heading(name.removesuffix(".png").replace("_", " "), 3))
        pairs.append(SideBySide([each for each in shown if each is not None]))
    if pairs:
        blocks += [Heading("Side by side"), *pairs]
    rest: list[Block] = []
    for section, differences in comparison.sections.items():
        rest += [
            Heading(section or "Overall", 3),
            ReportTable(COLUMNS, [d.row for d in differences]),
        ]
    if rest:
        blocks.append(Folded("All that differs", rest))
    return write_report_files(directory, title, blocks, "comparison.json", comparison.as_dict())


def both_over_time(steps: Sequence[Sequence[Mapping[str, Any]]]) -> "Figure":
    """Draw the scores of two sessions, as a report's data has them, on the same axes."""
    from matplotlib.figure import Figure

    from mmt.evaluation.reports.figures import line_style, style_axes

    by_distance = {all(s.get("completion") == s.get("distance") for s in each) for each in steps}
    panels = (
        ("within_jnd", "within JND, strokes made"),
        ("power_error_db", "power error (dB rms)"),
        ("gfc", "GFC of held-out segments"),
        # of different criteria that which both have
        ("completion", "completion") if len(by_distance) == 1 else ("distance", "distance sum"),
    )
    figure = Figure(figsize=(8.4, 5.4), layout="constrained")
    for axis, (name, title) in zip(figure.subplots(2, 2).ravel(), panels, strict=True):
        for number, (letter, scores) in enumerate(zip("AB", steps, strict=True)):
            values = [np.nan if (value := score.get(name)) is None else value for score in scores]
            times_s = [score.get("time_s", np.nan) for score in scores]
            axis.plot(times_s, values, label=letter, **line_style(number))
        if name == "power_error_db":
            axis.axhline(JND_DB, color=LIGHT["faint"], linestyle="--", linewidth=1.0)
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("session time (s)")
        style_axes(axis)
    figure.legend(
        *axis.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False
    )
    return figure


def _picture(letter: str, folder: Path, name: str) -> Picture | None:
    """Return a figure of a report, or None if the report does not have it."""
    path = folder / FIGURES / name
    if not path.exists():
        return None
    with naming(f"report {path}"):
        return Picture(f"{FIGURES}/{letter}-{name}", path.read_bytes(), f"{letter}: {folder}")
