"""Interpolation between samples: what it costs, and how far spectrum and level are off."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.settings import Method
from mmt_lab.bench.measuring import interleave
from mmt_lab.bench.textures import Truth, exact_samples, scattered
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import (
    MICROSECONDS,
    Axis,
    Curves,
    Findings,
    FindingsTable,
    Panel,
    Spread,
)

Filters = tuple[FloatArray, FloatArray]
"""Line spectral frequencies (k, m) and variances (k,)."""

Query = Callable[[FloatArray, FloatArray], Filters]
"""From speeds (mm/s) and forces (N), (k,), to filters."""

METHODS: Final[tuple[Method, ...]] = ("field", "published")
FLOOR: Final = "none: the filter of each point itself"
TIME: Final = Axis("time of a point (µs)", "µs")
SHAPE: Final = Axis("error of the spectrum (1 - GFC)", "1 - GFC")
LEVEL: Final = Axis("error of the power (dB rms)", "dB")

SURFACES: Final = ("plastic", "mesh", "wood", "ribbed")
COUNTS: Final = (10, 20, 40, 80, 160)
TABLE_COUNT: Final = 40
ORDER: Final = 16
DRAWS: Final = 3
ROUNDS: Final = 7


def run() -> Findings:
    """Measure what both methods make of the same samples."""
    truths = [Truth(name) for name in SURFACES]
    shape, level = Curves(), Curves()
    rows = []
    for count in COUNTS:
        errors = [_errors(truth, count) for truth in truths]
        times = _times(truths[0], count)
        for name, time in times.items():
            mean = np.mean([of[name] for of in errors], axis=0)
            shape.add(name, count, time, mean[0])
            level.add(name, count, time, mean[1])
        if count == TABLE_COUNT:
            rows = _rows(truths, errors)
    return Findings(
        title="Interpolation in the speed-force plane",
        about=(
            f"Samples scattered at random over the plane, each with the exact filter of order "
            f"{ORDER} and the exact power of the texture {', '.join(SURFACES)} there, "
            "so that no fit's scatter is in the errors. Errors against the texture itself at "
            f"12 x 12 points, the mean over textures and {DRAWS} draws of samples. Time "
            "of one point out of 144."
        ),
        panels=(
            Panel("spectrum", "Spectrum, by the samples", "samples", TIME, SHAPE, shape.done()),
            Panel("power", "Power, by the samples", "samples", TIME, LEVEL, level.done()),
        ),
        records=(FindingsTable("textures", f"By texture, {TABLE_COUNT} samples", tuple(rows)),),
    )


def _queries(samples: TextureSamples) -> dict[str, Query]:
    """Return both methods, built on these samples."""
    return {method: TextureModel(samples, method=method).at for method in METHODS}


def _errors(truth: Truth, count: int) -> dict[str, tuple[float, float]]:
    """Return, by method, the mean errors over draws of samples."""
    found: dict[str, list[tuple[float, float]]] = {method: [] for method in METHODS}
    for seed in range(DRAWS):
        samples = exact_samples(truth.surface, *scattered(count, seed), ORDER)
        for name, query in _queries(samples).items():
            found[name].append(truth.errors(*query(truth.speed_mm_s, truth.force_n)))
    return {name: tuple(np.mean(of, axis=0).tolist()) for name, of in found.items()}


def _times(truth: Truth, count: int) -> dict[str, Spread]:
    """Return the microseconds of one point, by method."""
    samples = exact_samples(truth.surface, *scattered(count, 0), ORDER)
    speed_mm_s, force_n = truth.speed_mm_s, truth.force_n
    tasks = {name: partial(query, speed_mm_s, force_n) for name, query in _queries(samples).items()}
    times = interleave(tasks, ROUNDS)
    return {name: time.times(MICROSECONDS / len(speed_mm_s)) for name, time in times.items()}


def _rows(
    truths: Sequence[Truth], errors: Sequence[dict[str, tuple[float, float]]]
) -> list[dict[str, str | float]]:
    """Return a row for each texture and method, and one for the error of the order alone."""
    rows: list[dict[str, str | float]] = []
    for truth, of in zip(truths, errors, strict=True):
        own = exact_samples(truth.surface, truth.speed_mm_s, truth.force_n, ORDER)
        for name, (shape, level) in {**of, FLOOR: truth.errors(own.lsf, own.variance)}.items():
            rows.append(
                {
                    "texture": truth.surface.name,
                    "method": name,
                    "1 - GFC": shape,
                    "power error (dB)": level,
                }
            )
    return rows


EXPERIMENT = Experiment(
    shows="how far models between their samples are off, by either method",
    duration="20 s",
    run=run,
    group="bench",
)
