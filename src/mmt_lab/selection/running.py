"""Paper C's Table II on trials of known texture: the published algorithm and ours, by seed."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal
from zlib import crc32

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.testing.simulation.textures import SURFACES
from mmt.texture.autoregression.spectra import lsf_spectrum
from mmt.texture.selection import ModelPoints, select, select_published
from mmt.texture.selection.enclosing_simplex import enclose_each
from mmt.texture.signals.amplitude_spectra import expected_amplitude
from mmt.texture.signals.metrics import gfc_of_rows
from mmt_lab.harness.processes import each
from mmt_lab.selection.sessions import session_trials
from mmt_lab.selection.trials import NOISE_M_S2, Trials, points_of, simulate_trials

Method = Literal["published", "ours", "ours, model's data"]
METHODS: Final[tuple[Method, ...]] = ("published", "ours", "ours, model's data")

_PROBES: Final = 200
_FLOOR: Final = NOISE_M_S2**2  # a texture may be silent somewhere, which no sensor hears
_DENSITY_HZ: Final = np.arange(501.0)
_BINS: Final = slice(1, None)  # of Welch's estimate: 15.6 to 500 Hz


@dataclass(frozen=True)
class Row:
    """A row of Table II: its name there, the sizes, and the texture that stands in."""

    name: str
    surface: str
    points: int
    outliers: int
    directed: bool


ROWS: Final = (
    Row("Grass", "sandpaper", 236, 23, directed=False),
    Row("Cardboard", "plastic", 253, 25, directed=False),
    Row("Wood", "oak", 432, 43, directed=True),
    Row("Washcloth", "corduroy", 461, 46, directed=True),
)


@dataclass(frozen=True)
class SelectionResult:
    """One method on one seed of one row.

    ``false_alarms_without`` is the share removed from the same trials without any knock. Changes
    of GFC and of the power error (dB rms) are against the model of all points.
    """

    row: str
    surface: str
    method: Method
    seed: int
    detected: float
    false_alarms: float
    false_alarms_without: float
    compression: float
    gfc: float
    gfc_change: float
    power_error_db: float
    power_change_db: float
    same_when_shuffled: bool
    seconds: float


def run_seed(row: Row, seed: int, recorded: Sequence[FloatArray] = ()) -> list[SelectionResult]:
    """Simulate the trials of one seed, and select from them by every method.

    Parameters
    ----------
    row
        What of Table II.
    seed
        Seed of all random numbers.
    recorded
        Knocks; see `simulate_trials`.
    """
    generator = np.random.default_rng([seed, row.points])
    trials = simulate_trials(
        SURFACES[row.surface],
        row.points,
        row.outliers,
        generator,
        directed=row.directed,
        recorded=recorded,
    )
    return _judged(trials, row.name, row.surface, seed, generator)


def run_texture(
    texture: str, seed: int, hand: str = "strokes", taps: Path | None = None
) -> list[SelectionResult]:
    """Simulate the sessions of one seed on any texture, and select from them by every method.

    Parameters and errors are those of `session_trials`.
    """
    generator = np.random.default_rng([seed, crc32(texture.encode())])
    trials = session_trials(texture, hand, seed, generator, taps)
    return _judged(trials, trials.surface.name, texture, seed, generator)


def _judged(
    trials: Trials, row: str, surface: str, seed: int, generator: np.random.Generator
) -> list[SelectionResult]:
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
                row=row,
                surface=surface,
                method=method,
                seed=seed,
                detected=float(outlier[trials.knocked].mean()),
                false_alarms=float(outlier[~trials.knocked].mean()),
                false_alarms_without=float(_run(method, trials.without)[0].mean()),
                compression=count / int(kept.sum()),
                gfc=score[0],
                gfc_change=score[0] - everything[0],
                power_error_db=score[1],
                power_change_db=score[1] - everything[1],
                same_when_shuffled=bool((again[1] == kept[order]).all()),
                seconds=seconds,
            )
        )
    return results


def _run(method: Method, data: ModelPoints) -> tuple[BoolArray, BoolArray]:
    if method == "published":
        published = select_published(data)
        return published.outlier, published.kept
    if method == "ours, model's data":
        data = ModelPoints(data.points, data.lsf, data.variance)
    ours = select(data)
    return ours.outlier, ours.kept


class _Probes:
    """Strokes that no model has seen, and the truth there."""

    def __init__(self, trials: Trials, generator: np.random.Generator) -> None:
        self._data = trials.data
        speed = generator.uniform(40.0, 270.0, _PROBES)
        force = generator.uniform(0.4, 2.6, _PROBES)
        heading = generator.uniform(0.0, 2.0 * np.pi, _PROBES)
        heading *= float(trials.directed)
        points = points_of(speed, force, heading, directed=trials.directed)
        self._points = np.ascontiguousarray(np.vstack([trials.data.points, points]))
        truth = trials.surface.spectrum(speed, force, _DENSITY_HZ, heading)
        self._amplitude = expected_amplitude(truth)[:, _BINS]
        self._power = truth.sum(axis=1)

    def score(self, kept: BoolArray) -> tuple[float, float]:
        """Return mean GFC and the rms of the power error in dB of a model of the kept points.

        Beyond the hull of the kept points the nearest one stands in.
        """
        count = len(kept)
        present = np.append(kept, np.zeros(_PROBES, dtype=np.bool_))
        size = self._points.shape[1] + 1
        members = np.empty((_PROBES, size), dtype=np.int64)
        weights, prices = np.zeros((2, _PROBES, size))
        candidates = np.flatnonzero(kept)
        enclose_each(
            self._points,
            np.tile(candidates, _PROBES),
            np.arange(_PROBES + 1) * candidates.size,
            present,
            np.arange(count, count + _PROBES),
            members,
            weights,
            prices,
        )
        beyond = members[:, 0] < 0
        offsets = self._points[count:][beyond, None, :] - self._points[candidates][None, :, :]
        members[beyond] = candidates[np.argmin((offsets**2).sum(axis=2), axis=1)][:, None]
        weights[beyond] = 1.0 / size
        lsf = np.einsum("qc,qco->qo", weights, self._data.lsf[members])
        variance = np.einsum("qc,qc->q", weights, self._data.variance[members])
        density = lsf_spectrum(lsf, variance, _DENSITY_HZ, 1000.0)
        gfc = gfc_of_rows(expected_amplitude(density)[:, _BINS], self._amplitude)
        modelled = np.maximum(density.sum(axis=1), _FLOOR)
        error_db = 10.0 * np.log10(modelled / np.maximum(self._power, _FLOOR))
        return float(gfc.mean()), float(np.sqrt(np.mean(error_db**2)))


def run_textures(
    seeds: Sequence[int],
    textures: Sequence[str],
    hand: str = "strokes",
    taps: Path | None = None,
    workers: int | None = None,
) -> list[SelectionResult]:
    """Run textures on each seed in local processes; see `run_texture`."""
    calls = [(texture, seed, hand, taps) for texture in textures for seed in seeds]
    found = each(run_texture, calls, workers=workers, what="sample selection")
    return [one for results in found for one in results]


def run_rows(
    seeds: Sequence[int], recorded: Sequence[FloatArray] = (), *, rows: Sequence[Row] = ROWS
) -> list[SelectionResult]:
    """Run every row on each seed; about 3 s a row and seed on a busy machine.

    One after the other, in this process: the time of each selection is a figure.
    """
    calls = [(row, seed, recorded) for row in rows for seed in seeds]
    found = each(run_seed, calls, workers=1, what="sample selection")
    return [one for results in found for one in results]
