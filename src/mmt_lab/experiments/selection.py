"""Sample selection, the published algorithm against mmt's own, on any textures.

Sessions on known textures with planted knocks are simulated, and each method selects from them.
The points removed and kept, and the model of the kept points, are compared with the truth. Paper
C's own tables are made by `mmt lab paper-c`.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal
from zlib import crc32

import numpy as np
import typer
from scipy.spatial import cKDTree

from mmt.core.arrays import BoolArray
from mmt.evaluation.model_errors import Strokes, root_mean_square
from mmt.evaluation.reports.document import ReportTable, table_of
from mmt.texture.autoregression.forms import lsf_spectrum
from mmt.texture.signals.metrics import expected_amplitude, gfc_of_rows
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
from mmt_lab.harness.processes import map_in_processes
from mmt_lab.selection.sessions import Trials, session_trials
from mmt_methods.selection import ModelPoints, select
from mmt_methods.selection.points import enclose
from mmt_methods.selection.published import select_published

Method = Literal["published", "ours", "ours, model's data"]
METHODS: Final[tuple[Method, ...]] = ("published", "ours", "ours, model's data")

_PROBES: Final = 200
_FLOOR: Final = 0.03**2  # least power, (m/s2)^2: less, as of a silent texture, is not measurable
_DENSITY_HZ: Final = np.arange(501.0)
_BINS: Final = slice(1, None)  # of Welch's estimate: 15.6 to 500 Hz


@dataclass(frozen=True)
class SelectionResult:
    """One method on one seed of one texture.

    ``false_alarms_without`` is the share removed from the same trials without any knock. Changes
    of GFC and of the power error (dB rms) are against the model of all points.
    """

    texture: str
    method: Method
    seed: int
    detected: float
    false_alarms: float
    false_alarms_without: float
    compression: float
    gfc_change: float
    power_change_db: float
    same_when_shuffled: bool
    seconds: float


def run_texture(
    texture: str, seed: int, hand: str = "strokes", taps: Path | None = None
) -> list[SelectionResult]:
    """Simulate the sessions of one seed on any texture, and select from them by every method.

    Parameters and errors are those of `session_trials`.
    """
    generator = np.random.default_rng([seed, crc32(texture.encode())])
    trials = session_trials(texture, hand, seed, generator, taps)
    probes = _Probes(trials, generator)
    count = len(trials.data)
    order = generator.permutation(count)
    everything = probes.score(np.ones(count, dtype=np.bool_))
    results = []
    for method in METHODS:
        started = time.perf_counter()
        outlier, kept = _run(method, trials.data)
        seconds = time.perf_counter() - started
        again = _run(method, trials.data.subset(order))
        score = probes.score(kept)
        results.append(
            SelectionResult(
                texture=trials.surface.name,
                method=method,
                seed=seed,
                detected=float(outlier[trials.knocked].mean()),
                false_alarms=float(outlier[~trials.knocked].mean()),
                false_alarms_without=float(_run(method, trials.without)[0].mean()),
                compression=count / int(kept.sum()),
                gfc_change=score[0] - everything[0],
                power_change_db=score[1] - everything[1],
                same_when_shuffled=bool((again[1] == kept[order]).all()),
                seconds=seconds,
            )
        )
    return results


def _run(method: Method, data: ModelPoints) -> tuple[BoolArray, BoolArray]:
    if method == "ours, model's data":
        data = ModelPoints(data.points, data.lsf, data.variance)
    found = select_published(data) if method == "published" else select(data)
    return found.outlier, found.kept


class _Probes:
    """Strokes that no model has seen, with the true spectra."""

    def __init__(self, trials: Trials, generator: np.random.Generator) -> None:
        self._data = trials.data
        speed = generator.uniform(40.0, 270.0, _PROBES)
        force = generator.uniform(0.4, 2.6, _PROBES)
        heading = generator.uniform(0.0, 2.0 * np.pi, _PROBES) * float(trials.space.directed)
        inputs = Strokes(speed, force, heading).inputs(trials.space)
        self._places = trials.space.normalise(inputs)
        truth = trials.surface.spectrum(speed, force, _DENSITY_HZ, heading)
        self._amplitude = expected_amplitude(truth)[:, _BINS]
        self._power = truth.sum(axis=1)

    def score(self, kept: BoolArray) -> tuple[float, float]:
        """Return mean GFC and the rms of the power error in dB of a model of the kept points.

        Outside the hull of the kept points, the nearest kept point is used.
        """
        points = self._data.points[kept]
        values = np.column_stack([self._data.lsf, self._data.variance])[kept]
        filters = enclose(points, self._places).interpolate(values)
        beyond = np.isnan(filters[:, 0])
        filters[beyond] = values[cKDTree(points).query(self._places[beyond])[1]]
        density = lsf_spectrum(filters[:, :-1], filters[:, -1], _DENSITY_HZ, 1000.0)
        gfc = gfc_of_rows(expected_amplitude(density)[:, _BINS], self._amplitude)
        modelled = np.maximum(density.sum(axis=1), _FLOOR)
        error_db = 10.0 * np.log10(modelled / np.maximum(self._power, _FLOOR))
        return float(gfc.mean()), root_mean_square(error_db)


SHOWS: Final = "how well sample selection finds knocks and keeps the model, published and ours"
TAKES: Final = "4 min"

FIGURES: Final[Mapping[str, tuple[str, str, str]]] = {
    "detected": ("detected", ".3f", "share of the planted knocks that the first stage removed"),
    "false_alarms": ("false alarms", ".3f", "share of the other points that it removed"),
    "false_alarms_without": (
        "without knocks",
        ".3f",
        "share of the points that it removes of the same trials without knocks",
    ),
    "compression": ("compression", ".2f", "points before over points kept"),
    "gfc_change": (
        "GFC change",
        "+.4f",
        "GFC (Welch, 64 samples, against the known truth at 200 strokes that no model has seen) of "
        "the kept points' model less that of all points' model, knocks included",
    ),
    "power_change_db": (
        "power change (dB)",
        "+.2f",
        "the same of the rms of the power error in dB",
    ),
    "same_when_shuffled": (
        "same shuffled",
        ".0%",
        "whether the same points are kept in another order",
    ),
    "seconds": ("time (s)", ".2f", ""),
}
"""Title, format and definition of each figure of a `SelectionResult`."""

DEFINITIONS: Final = {name: text for name, (_, _, text) in FIGURES.items() if text}


def means_of(results: Sequence[SelectionResult], name: str) -> list[dict[str, Any]]:
    """Return the mean figures of each method over results, of a texture or of all."""
    rows: list[dict[str, Any]] = []
    for method in METHODS:
        mine = [result for result in results if result.method == method]
        means = {key: float(np.mean([getattr(one, key) for one in mine])) for key in FIGURES}
        rows.append({"texture": name, "method": method, "seeds": len(mine), **means})
    return rows


def by_texture(results: Sequence[SelectionResult]) -> list[dict[str, Any]]:
    """Return the mean figures of each texture and method, over the seeds."""
    names = dict.fromkeys(result.texture for result in results)
    return [
        row for name in names for row in means_of([r for r in results if r.texture == name], name)
    ]


def selection_table(means: Sequence[Mapping[str, Any]]) -> ReportTable:
    """Return a row for each texture and method."""
    rows = [
        {
            "texture": mean["texture"],
            "method": mean["method"],
            **{title: format(mean[key], form) for key, (title, form, _) in FIGURES.items()},
        }
        for mean in means
    ]
    return table_of(rows, "Means over the seeds.")


def targets(overall: Sequence[Mapping[str, Any]]) -> tuple[Target, ...]:
    """Return the targets of mmt's method on all textures together, and its figures."""
    by_method = {mean["method"]: mean for mean in overall}
    published, ours = by_method["published"], by_method["ours"]
    return (
        Target("detected, as published", ours["detected"], "at least", published["detected"]),
        Target("detected", ours["detected"], "at least", 0.95),
        Target("false alarms", ours["false_alarms"], "at most", 0.03),
        Target("false alarms without knocks", ours["false_alarms_without"], "at most", 0.03),
        Target("compression", ours["compression"], "at least", 2.7),
        Target("loss of GFC", -ours["gfc_change"], "at most", 0.005),
        Target("same when shuffled", ours["same_when_shuffled"], "at least", 1.0),
        Target("time (s)", ours["seconds"], "at most", 2.0),
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
    kind, seeds_of = hand_of(hand).kind, range(seed, seed + seeds)
    calls = [
        (name, number, kind, taps) for name in chosen_textures(textures) for number in seeds_of
    ]
    found = map_in_processes(run_texture, calls, workers=workers, what="sample selection")
    results = [one for by_method in found for one in by_method]
    means, overall = by_texture(results), means_of(results, "all")
    return Findings(
        "Sample selection",
        "Three sessions of 18 s on each texture, a tenth of the segments with a knock of 0.4 of "
        "their variance.",
        tables=[selection_table([*means, *overall])],
        targets=targets(overall),
        definitions=DEFINITIONS,
        data={
            "means": means,
            "overall": overall,
            "results": [asdict(result) for result in results],
        },
    )
