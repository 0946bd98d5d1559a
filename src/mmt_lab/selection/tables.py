"""The evaluation of sample selection as tables, for programs, and as a report."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.evaluation.document import Table
from mmt_lab.judged_report import write_judged_report
from mmt_lab.selection.running import METHODS, ROWS, SelectionResult
from mmt_lab.selection.scaling import Scaling

TITLE: Final = "Sample selection"

TARGETS: Final = {
    "detected": 0.95,
    "false_alarms": 0.03,
    "compression": 2.7,
    "gfc_loss": 0.005,
    "seconds": 2.0,
    "speed_up": 20.0,
}

PAPER: Final = {
    "Grass": (0.78, 2.71, -0.0059),
    "Cardboard": (0.80, 2.43, 0.0078),
    "Wood": (0.74, 2.13, -0.051),
    "Washcloth": (0.69, 2.54, -0.0092),
}
"""Table II of paper C: detected, compression, relative change of GFC."""

DEFINITIONS: Final = {
    "detected": "share of the planted knocks that the first stage removed",
    "false_alarms": "share of the other points that it removed",
    "compression": "points before over points kept",
    "gfc_change": "GFC (Welch, 64 samples, against the known truth at 200 strokes that no model "
    "has seen) of the kept points' model less that of all points' model, knocks included",
    "power_change_db": "the same of the rms of the power error in dB",
    "same_when_shuffled": "whether the same points are kept in another order",
    "star_s": "seconds to leave every point out by its star; rebuilt_s: by rebuilding the "
    "triangulation, from 12 of the points; select_s: the whole selection",
}

_FIGURES: Final = (
    "detected",
    "false_alarms",
    "compression",
    "gfc",
    "gfc_change",
    "power_error_db",
    "power_change_db",
    "same_when_shuffled",
    "seconds",
)


@dataclass(frozen=True)
class SelectionEvaluation:
    """Every result, and how the cost grows."""

    results: Sequence[SelectionResult]
    scaling: Sequence[Scaling]

    def means(self) -> list[dict[str, Any]]:
        """Return the mean figures of each row and method, over the seeds."""
        rows = []
        for row in dict.fromkeys(result.row for result in self.results):
            for method in METHODS:
                mine = [r for r in self.results if r.row == row and r.method == method]
                means = {n: float(np.mean([getattr(r, n) for r in mine])) for n in _FIGURES}
                rows.append(
                    {
                        "row": row,
                        "surface": mine[0].surface,
                        "method": method,
                        "seeds": len(mine),
                        **means,
                    }
                )
        return rows

    def as_dict(self) -> dict[str, Any]:
        """Return everything for a program."""
        return {
            "means": self.means(),
            "paper": {
                name: dict(zip(("detected", "compression", "gfc_change"), values, strict=True))
                for name, values in PAPER.items()
            },
            "results": [asdict(result) for result in self.results],
            "scaling": [asdict(row) for row in self.scaling],
            "targets": TARGETS,
            "definitions": DEFINITIONS,
        }


def selection_tables(evaluation: SelectionEvaluation) -> list[Table]:
    """Return Table II again, and the growth of the cost."""
    sizes = {row.name: f"{row.points}/{row.outliers}" for row in ROWS}
    rows = [
        [
            f"{mean['row']} ({mean['surface']})",
            sizes.get(mean["row"], ""),
            mean["method"],
            f"{mean['detected']:.3f}",
            f"{mean['false_alarms']:.3f}",
            f"{mean['compression']:.2f}",
            f"{mean['gfc_change']:+.4f}",
            f"{mean['power_change_db']:+.2f}",
            f"{mean['same_when_shuffled']:.0%}",
            f"{mean['seconds']:.2f}",
        ]
        for mean in evaluation.means()
    ]
    columns = ["texture", "points/ knocks", "method", "detected", "false alarms", "compression"]
    columns += ["GFC change", "power change (dB)", "same shuffled", "time (s)"]
    tables = [Table(columns, rows, caption="Means over the seeds.")]
    if evaluation.scaling:
        tables.append(_scaling_table(evaluation.scaling))
    return tables


def _scaling_table(scaling: Sequence[Scaling]) -> Table:
    rows = [
        [
            str(row.dimensions),
            str(row.points),
            f"{row.star_s * 1e3:.1f}",
            f"{row.rebuilt_s * 1e3:.0f}",
            f"{row.rebuilt_s / row.star_s:.0f}",
            f"{row.same}/{row.compared}",
            f"{row.select_s:.2f}",
        ]
        for row in scaling
    ]
    columns = ["dimensions", "points", "by stars (ms)", "rebuilt (ms)", "ratio", "same"]
    return Table([*columns, "selection (s)"], rows, caption="Every point left out once.")


def verdicts(evaluation: SelectionEvaluation) -> list[str]:
    """Return in words which targets ours met, row by row."""
    sentences = []
    for mean in evaluation.means():
        if mean["method"] != "ours":
            continue
        missed = [
            text
            for bad, text in (
                (mean["detected"] < TARGETS["detected"], f"detected {mean['detected']:.3f}"),
                (
                    mean["false_alarms"] > TARGETS["false_alarms"],
                    f"false alarms {mean['false_alarms']:.3f}",
                ),
                (
                    mean["compression"] < TARGETS["compression"],
                    f"compression {mean['compression']:.2f}",
                ),
                (-mean["gfc_change"] > TARGETS["gfc_loss"], f"GFC {mean['gfc_change']:+.4f}"),
                (mean["same_when_shuffled"] < 1.0, "depends on the order"),
                (mean["seconds"] > TARGETS["seconds"], f"{mean['seconds']:.1f} s"),
            )
            if bad
        ]
        words = f"targets missed: {', '.join(missed)}" if missed else "all targets met"
        sentences.append(f"{mean['row']} ({mean['surface']}): {words}")
    return sentences


def write_selection_report(directory: Path, evaluation: SelectionEvaluation) -> Path:
    """Write ``report.html``, ``report.md`` and ``summary.json``; return the page.

    Raises
    ------
    InputError
        The directory cannot be written.
    """
    return write_judged_report(
        directory,
        TITLE,
        verdicts(evaluation),
        selection_tables(evaluation),
        DEFINITIONS,
        evaluation.as_dict(),
    )
