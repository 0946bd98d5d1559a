"""Interpolation between samples: what it costs, and how far spectrum and level are off."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_reflection
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.settings import Interpolated
from mmt_lab.bench.measuring import interleave
from mmt_lab.bench.textures import Truth, exact_samples, scattered
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import (
    MICROSECONDS,
    Axis,
    Curves,
    Findings,
    Panel,
    Records,
    Spread,
)

Filters = tuple[FloatArray, FloatArray]
"""Line spectral frequencies (k, m) and variances (k,)."""

Query = Callable[[FloatArray, FloatArray], Filters]
"""From speeds (mm/s) and forces (N), (k,), to filters."""

LINEAR: Final[tuple[Interpolated, ...]] = ("power", "variance", "amplitude")
FLOOR: Final = "none: the filter of each point itself"
TIME: Final = Axis("time of a point (µs)", "µs")
SHAPE: Final = Axis("error of the spectrum (1 - GFC)", "1 - GFC")
LEVEL: Final = Axis("error of the power (dB rms)", "dB")


@dataclass(frozen=True)
class Plan:
    """What is measured; the defaults are what ``mmt bench interpolation`` does."""

    surfaces: tuple[str, ...] = ("plastic", "mesh", "wood", "ribbed")
    counts: tuple[int, ...] = (10, 20, 40, 80, 160)
    table_count: int = 40
    order: int = 16
    draws: int = 3
    rounds: int = 7


def measure(plan: Plan) -> Findings:
    """Measure Delaunay interpolation, three ways, beside its alternatives."""
    truths = [Truth(name) for name in plan.surfaces]
    shape, level = Curves(), Curves()
    rows = []
    for count in plan.counts:
        errors = [_errors(truth, count, plan) for truth in truths]
        times = _times(truths[0], count, plan)
        for name, time in times.items():
            shape.add(name, count, time, _mean([of[name][0] for of in errors]))
            level.add(name, count, time, _mean([of[name][1] for of in errors]))
        if count == plan.table_count:
            rows = _rows(truths, errors, plan)
    return Findings(
        name="interpolation",
        title="Interpolation in the speed-force plane",
        about=(
            f"Samples scattered at random over the plane, each with the exact filter of order "
            f"{plan.order} and the exact power of the texture {', '.join(plan.surfaces)} there, "
            "so that no fit's scatter is in the errors. Errors against the texture itself at "
            f"12 x 12 points, the mean over textures and {plan.draws} draws of samples. Time "
            "of one point out of 144. Delaunay with the model's boundary points; nearest "
            "sample and inverse squared distance over the samples alone."
        ),
        panels=(
            Panel("spectrum", "Spectrum, by the samples", "samples", TIME, SHAPE, shape.done()),
            Panel("power", "Power, by the samples", "samples", TIME, LEVEL, level.done()),
        ),
        records=(Records("textures", f"By texture, {plan.table_count} samples", tuple(rows)),),
    )


def _queries(samples: TextureSamples) -> dict[str, Query]:
    """Return every method, built on these samples."""
    queries: dict[str, Query] = {
        f"Delaunay, linear {kind}": TextureModel(samples, interpolate=kind).at for kind in LINEAR
    }
    return {**queries, "nearest": _nearest(samples), "inverse distance": _inverse_distance(samples)}


def _nearest(samples: TextureSamples) -> Query:
    def query(speed_mm_s: FloatArray, force_n: FloatArray) -> Filters:
        index = _squares(samples, speed_mm_s, force_n).argmin(axis=1)
        return samples.lsf[index], samples.variance[index]

    return query


def _inverse_distance(samples: TextureSamples) -> Query:
    """Shepard, "A two-dimensional interpolation function for irregularly-spaced data", 1968."""

    def query(speed_mm_s: FloatArray, force_n: FloatArray) -> Filters:
        weights = 1.0 / np.maximum(_squares(samples, speed_mm_s, force_n), 1e-12)
        weights /= weights.sum(axis=1, keepdims=True)
        lsf = weights @ samples.lsf
        gain = np.prod(1.0 - lsf_to_reflection(lsf) ** 2, axis=1)
        return lsf, (weights @ samples.power) * gain

    return query


def _squares(samples: TextureSamples, speed_mm_s: FloatArray, force_n: FloatArray) -> FloatArray:
    """Return the squared distances (k, n) in the normalised plane."""
    speed = (speed_mm_s[:, np.newaxis] - samples.speed_mm_s) / 300.0
    force = (force_n[:, np.newaxis] - samples.force_n) / 3.0
    return speed * speed + force * force


def _errors(truth: Truth, count: int, plan: Plan) -> dict[str, tuple[float, float]]:
    """Return, by method, the mean errors over draws of samples."""
    found: dict[str, list[tuple[float, float]]] = {}
    for seed in range(plan.draws):
        samples = exact_samples(truth.surface, *scattered(count, seed), plan.order)
        for name, query in _queries(samples).items():
            errors = truth.errors(*query(truth.speed_mm_s, truth.force_n))
            found.setdefault(name, []).append(errors)
    return {
        name: (_mean([e[0] for e in of]), _mean([e[1] for e in of])) for name, of in found.items()
    }


def _times(truth: Truth, count: int, plan: Plan) -> dict[str, Spread]:
    """Return the microseconds of one point, by method."""
    samples = exact_samples(truth.surface, *scattered(count, 0), plan.order)
    speed_mm_s, force_n = truth.speed_mm_s, truth.force_n
    tasks = {name: _bound(query, speed_mm_s, force_n) for name, query in _queries(samples).items()}
    times = interleave(tasks, plan.rounds)
    return {name: time.times(MICROSECONDS / len(speed_mm_s)) for name, time in times.items()}


def _bound(query: Query, speed_mm_s: FloatArray, force_n: FloatArray) -> Callable[[], Filters]:
    return lambda: query(speed_mm_s, force_n)


def _rows(
    truths: Sequence[Truth], errors: Sequence[dict[str, tuple[float, float]]], plan: Plan
) -> list[dict[str, str | float]]:
    """Return a row for each texture and method, and one for the error of the order alone."""
    rows: list[dict[str, str | float]] = []
    for truth, of in zip(truths, errors, strict=True):
        own = exact_samples(truth.surface, truth.speed_mm_s, truth.force_n, plan.order)
        for name, (shape, level) in {**of, FLOOR: truth.errors(own.lsf, own.variance)}.items():
            rows.append(
                {
                    "texture": truth.surface.name,
                    "interpolation": name,
                    "1 - GFC": shape,
                    "power error (dB)": level,
                }
            )
    return rows


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def run() -> Findings:
    """Measure Delaunay interpolation, three ways, beside its alternatives."""
    return measure(Plan())


EXPERIMENT = Experiment(
    shows="how far models between their samples are off, by the way they interpolate",
    duration="20 s",
    run=run,
    group="bench",
)
