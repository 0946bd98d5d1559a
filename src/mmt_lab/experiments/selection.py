"""Sample selection, the published algorithm against mmt's own, on any textures.

Sessions on known textures with planted knocks are simulated, and each method selects from them.
The points removed and kept, and the model of the kept points, are compared with the truth. Paper
C's own tables are made by `mmt lab paper-c`.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer

from mmt.evaluation.document import ReportTable
from mmt_lab.harness.experiment import (
    HandKind,
    Seed,
    Seeds,
    Textures,
    Workers,
    chosen_textures,
    hand_of,
)
from mmt_lab.harness.findings import Findings, Target
from mmt_lab.selection.running import METHODS, SelectionResult, run_textures

SHOWS: Final = "how well sample selection finds knocks and keeps the model, published and ours"
TAKES: Final = "4 min"

TITLE: Final = "Sample selection"

TARGETS: Final = {
    "detected": 0.95,
    "false_alarms": 0.03,
    "compression": 2.7,
    "gfc_loss": 0.005,
    "seconds": 2.0,
}

DEFINITIONS: Final = {
    "detected": "share of the planted knocks that the first stage removed",
    "false_alarms": "share of the other points that it removed",
    "false_alarms_without": "share of the points that it removes of the same trials without knocks",
    "compression": "points before over points kept",
    "gfc_change": "GFC (Welch, 64 samples, against the known truth at 200 strokes that no model "
    "has seen) of the kept points' model less that of all points' model, knocks included",
    "power_change_db": "the same of the rms of the power error in dB",
    "same_when_shuffled": "whether the same points are kept in another order",
}

_FIGURES: Final = (
    "detected",
    "false_alarms",
    "false_alarms_without",
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
    """Results of all methods on all textures and seeds."""

    results: Sequence[SelectionResult]

    def overall(self) -> list[dict[str, Any]]:
        """Return the mean figures of each method over all results."""
        return [{"texture": "all", **_means(self.results, method)} for method in METHODS]

    def means(self) -> list[dict[str, Any]]:
        """Return the mean figures of each texture and method, over the seeds."""
        rows = []
        for texture in dict.fromkeys(result.texture for result in self.results):
            mine = [result for result in self.results if result.texture == texture]
            rows += [{"texture": texture, **_means(mine, method)} for method in METHODS]
        return rows

    def as_dict(self) -> dict[str, Any]:
        """Return all results as a dictionary for JSON."""
        return {
            "means": self.means(),
            "overall": self.overall(),
            "results": [asdict(result) for result in self.results],
            "targets": TARGETS,
            "definitions": DEFINITIONS,
        }


def selection_table(evaluation: SelectionEvaluation) -> ReportTable:
    """Return a row for each texture and method, and the means over all."""
    rows = [
        [
            mean["texture"],
            mean["method"],
            f"{mean['detected']:.3f}",
            f"{mean['false_alarms']:.3f}",
            f"{mean['false_alarms_without']:.3f}",
            f"{mean['compression']:.2f}",
            f"{mean['gfc_change']:+.4f}",
            f"{mean['power_change_db']:+.2f}",
            f"{mean['same_when_shuffled']:.0%}",
            f"{mean['seconds']:.2f}",
        ]
        for mean in [*evaluation.means(), *evaluation.overall()]
    ]
    columns = ["texture", "method", "detected", "false alarms"]
    columns += ["without knocks", "compression"]
    columns += ["GFC change", "power change (dB)", "same shuffled", "time (s)"]
    return ReportTable(columns, rows, caption="Means over the seeds.")


def remarks(evaluation: SelectionEvaluation) -> list[str]:
    """Return a sentence on each method over all results."""
    return [
        f"{mean['method']}: {mean['detected']:.2f} of the knocks found; {mean['false_alarms']:.3f} "
        f"of the other points removed, {mean['false_alarms_without']:.3f} without any knock"
        for mean in evaluation.overall()
    ]


def targets(evaluation: SelectionEvaluation) -> tuple[Target, ...]:
    """Return the targets of mmt's method on all textures together, and its figures."""
    (published,), (ours,) = (
        [mean for mean in evaluation.overall() if mean["method"] == method]
        for method in ("published", "ours")
    )
    return (
        Target("detected, as published", ours["detected"], "at least", published["detected"]),
        Target("detected", ours["detected"], "at least", TARGETS["detected"]),
        Target("false alarms", ours["false_alarms"], "at most", TARGETS["false_alarms"]),
        Target(
            "false alarms without knocks",
            ours["false_alarms_without"],
            "at most",
            TARGETS["false_alarms"],
        ),
        Target("compression", ours["compression"], "at least", TARGETS["compression"]),
        Target("loss of GFC", -ours["gfc_change"], "at most", TARGETS["gfc_loss"]),
        Target("same when shuffled", ours["same_when_shuffled"], "at least", 1.0),
        Target("time (s)", ours["seconds"], "at most", TARGETS["seconds"]),
    )


def run(
    textures: Textures = None,
    hand: HandKind = "strokes",
    taps: Annotated[
        Path | None, typer.Option(help="Folder of the Penn toolkit's taps, taken as knocks.")
    ] = None,
    seeds: Seeds = 3,
    seed: Seed = 0,
    workers: Workers = None,
) -> Findings:
    """Compare sample selection as published with mmt's own."""
    chosen = chosen_textures(textures)
    results = run_textures(range(seed, seed + seeds), chosen, hand_of(hand).kind, taps, workers)
    evaluation = SelectionEvaluation(results)
    return Findings(
        TITLE,
        "Three sessions of 18 s on each texture, a tenth of the segments with a knock of 0.4 of "
        "their variance.",
        tables=[selection_table(evaluation)],
        sentences=remarks(evaluation),
        targets=targets(evaluation),
        definitions=DEFINITIONS,
        data=evaluation.as_dict(),
    )


def _means(results: Sequence[SelectionResult], method: str) -> dict[str, Any]:
    mine = [result for result in results if result.method == method]
    means = {name: float(np.mean([getattr(one, name) for one in mine])) for name in _FIGURES}
    return {"method": method, "seeds": len(mine), **means}
