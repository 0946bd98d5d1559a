"""Sample selection on trials of known texture: the published algorithm and ours, by seed."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal
from zlib import crc32

import numpy as np
from scipy.spatial import cKDTree

from mmt.core.arrays import BoolArray
from mmt.texture.autoregression.spectra import lsf_spectrum
from mmt.texture.signals.amplitude_spectra import expected_amplitude
from mmt.texture.signals.metrics import gfc_of_rows
from mmt.texture.space import InputSpace
from mmt_lab.selection.sessions import Trials, session_trials
from mmt_methods.selection import ModelPoints, select
from mmt_methods.selection.published import select_published
from mmt_methods.selection.simplices import enclose

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
    gfc: float
    gfc_change: float
    power_error_db: float
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
    """Strokes that no model has seen, with the true spectra."""

    def __init__(self, trials: Trials, generator: np.random.Generator) -> None:
        self._data = trials.data
        speed = generator.uniform(40.0, 270.0, _PROBES)
        force = generator.uniform(0.4, 2.6, _PROBES)
        heading = generator.uniform(0.0, 2.0 * np.pi, _PROBES) * float(trials.directed)
        along, across = speed * np.cos(heading), speed * np.sin(heading)
        inputs = (along, across, force) if trials.directed else (speed, force)
        space = InputSpace("anisotropic" if trials.directed else "isotropic")
        self._places = space.normalise(np.column_stack(inputs))
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
        return float(gfc.mean()), float(np.sqrt(np.mean(error_db**2)))
