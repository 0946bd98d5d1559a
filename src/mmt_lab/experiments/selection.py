"""Sample selection, the published algorithm against ours: paper C's Table II again.

Trials of known textures with planted knocks are simulated; each method selects from them. What
it removed and kept, and the model of what it kept, are compared with the truth. The cost of
leaving every point out once is measured for growing numbers of points.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer

from mmt.core.errors import InputError
from mmt.evaluation.document import Table
from mmt_lab.harness.experiment import (
    Experiment,
    HandKind,
    Seed,
    Seeds,
    Textures,
    Workers,
    chosen_textures,
    hand_of,
)
from mmt_lab.harness.findings import Findings, Target
from mmt_lab.selection.knocks import read_knocks
from mmt_lab.selection.running import METHODS, ROWS, SelectionResult, run_rows, run_textures
from mmt_lab.selection.scaling import Scaling, measure_scaling

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
    "false_alarms_without": "share of the points that it removes of the same trials without knocks",
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
    """Every result, and how the cost grows; of Table II, or of textures that were named."""

    results: Sequence[SelectionResult]
    scaling: Sequence[Scaling] = ()
    of_textures: bool = False

    def name(self, mean: Mapping[str, Any]) -> str:
        """Return what a row of means is called."""
        return str(mean["row"]) if self.of_textures else f"{mean['row']} ({mean['surface']})"

    def overall(self) -> list[dict[str, Any]]:
        """Return the mean figures of each method over all results."""
        return [
            {"row": "all", "surface": "all", **_means(self.results, method)} for method in METHODS
        ]

    def means(self) -> list[dict[str, Any]]:
        """Return the mean figures of each row and method, over the seeds."""
        rows = []
        for row in dict.fromkeys(result.row for result in self.results):
            for method in METHODS:
                mine = [result for result in self.results if result.row == row]
                named = {"row": row, "surface": mine[0].surface}
                rows.append({**named, **_means(mine, method)})
        return rows

    def as_dict(self) -> dict[str, Any]:
        """Return everything for a program."""
        return {
            "means": self.means(),
            "overall": self.overall(),
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
    """Return Table II again, or a row for each texture, and the growth of the cost."""
    sizes = {row.name: f"{row.points}/{row.outliers}" for row in ROWS}
    overall = evaluation.overall() if evaluation.of_textures else []
    rows = [
        [
            evaluation.name(mean),
            sizes.get(mean["row"], ""),
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
        for mean in [*evaluation.means(), *overall]
    ]
    columns = ["texture", "points/ knocks", "method", "detected", "false alarms"]
    columns += ["without knocks", "compression"]
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


def remarks(evaluation: SelectionEvaluation) -> list[str]:
    """Return a sentence on each method over all results."""
    return [
        f"{mean['method']}: {mean['detected']:.2f} of the knocks found; {mean['false_alarms']:.3f} "
        f"of the other points removed, {mean['false_alarms_without']:.3f} without any knock"
        for mean in evaluation.overall()
    ]


def targets(evaluation: SelectionEvaluation) -> tuple[Target, ...]:
    """Return what our method is to reach on each row, or on all textures, and what it reached."""
    found = []
    for mean in evaluation.overall() if evaluation.of_textures else evaluation.means():
        if mean["method"] != "ours":
            continue
        name = evaluation.name(mean)
        found += [
            Target(f"{name}: detected", mean["detected"], "at least", TARGETS["detected"]),
            Target(
                f"{name}: false alarms", mean["false_alarms"], "at most", TARGETS["false_alarms"]
            ),
            Target(f"{name}: compression", mean["compression"], "at least", TARGETS["compression"]),
            Target(f"{name}: loss of GFC", -mean["gfc_change"], "at most", TARGETS["gfc_loss"]),
            Target(f"{name}: same when shuffled", mean["same_when_shuffled"], "at least", 1.0),
            Target(f"{name}: time (s)", mean["seconds"], "at most", TARGETS["seconds"]),
        ]
    return tuple(found)


def run(
    knocks: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[KNOCKS]...", help="Recordings of knocks on a table (.csv)."),
    ] = None,
    textures: Textures = None,
    hand: HandKind = "strokes",
    taps: Annotated[
        Path | None, typer.Option(help="Folder of the Penn toolkit's taps, taken as knocks.")
    ] = None,
    seeds: Seeds = 20,
    seed: Seed = 0,
    workers: Workers = None,
) -> Findings:
    """Compare sample selection as published with ours, on Table II or on textures named.

    Raises
    ------
    InputError
        A recording of knocks, a texture or the kind of hand cannot be used, or options do not go
        together.
    """
    numbers = range(seed, seed + seeds)
    if textures is not None:
        if knocks:
            raise InputError(
                "KNOCKS are of Table II, which --textures replaces: take --taps, or none"
            )
        chosen = chosen_textures(textures)
        results = run_textures(numbers, chosen, hand_of(hand).kind, taps, workers)
        return _findings(SelectionEvaluation(results, of_textures=True), "")
    if taps is not None or hand != "strokes":
        raise InputError(
            "--taps and --hand are for --textures: the trials of Table II have no hand"
        )
    recorded = read_knocks(knocks or [])
    half = f"{len(recorded)} recorded knocks; half of the planted ones are of these."
    evaluation = SelectionEvaluation(run_rows(numbers, recorded), measure_scaling())
    return _findings(evaluation, half if recorded else "")


def _means(results: Sequence[SelectionResult], method: str) -> dict[str, Any]:
    mine = [result for result in results if result.method == method]
    means = {name: float(np.mean([getattr(one, name) for one in mine])) for name in _FIGURES}
    return {"method": method, "seeds": len(mine), **means}


def _findings(evaluation: SelectionEvaluation, summary: str) -> Findings:
    return Findings(
        TITLE,
        summary,
        tables=selection_tables(evaluation),
        sentences=remarks(evaluation),
        targets=targets(evaluation),
        definitions=DEFINITIONS,
        data=evaluation.as_dict(),
    )


EXPERIMENT = Experiment(
    shows="how well sample selection finds knocks and keeps the model, published and ours",
    duration="4 min",
    run=run,
)
