"""Texture models of few, coincident, collinear and very many samples, and any input to them."""

import math
import time
from functools import partial
from timeit import repeat
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_reflection, output_power
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.stability.degenerate import build, of_plane
from mmt_lab.stability.families import CaseResult, Extreme, Family

MANY: Final = 5000

_EXPECTED: Final = "one whole plane; filters ordered, power in the samples' range"
_SPEED_MM_S, _FORCE_N = 300.0, 3.0


def cases(*, many: int = MANY, queries: int = 10_000) -> list[Extreme]:
    """Return the family's cases."""
    return [
        *(
            Extreme(what, _EXPECTED, partial(_plane, points, queries))
            for what, points in of_plane(many)
        ),
        Extreme(
            f"from {many // 10} to {many} samples",
            "building grows as n log n, rendering by less than 2 x",
            partial(_growth, many),
        ),
        Extreme(
            "queries NaN, infinite, negative, far outside",
            "as at the nearest edge, NaN as at zero",
            _any_query,
        ),
    ]


def _plane(points: FloatArray, queries: int) -> CaseResult:
    model = build(points)
    generator = np.random.default_rng(4)
    speed = np.concatenate([generator.uniform(0.0, _SPEED_MM_S, queries), 300.0 * points[:, 0]])
    force = np.concatenate([generator.uniform(0.0, _FORCE_N, queries), 3.0 * points[:, 1]])
    started = time.thread_time()
    lsf, variance = model.at(speed, force)
    microseconds = 1e6 * (time.thread_time() - started) / len(speed)
    gaps = np.diff(lsf, prepend=0.0, append=np.pi, axis=1)
    power = output_power(variance, lsf_to_reflection(lsf))
    highest = float(variance.max() / model.samples.variance.max())
    rendered = Synthesizer(model, limit_m_s2=np.inf).render(speed, force)
    area, least = _areas(model)
    return CaseResult(
        f"{len(model.vertices)} vertices, area 1 {area - 1.0:+.0e}, variance to {highest:.3f} of "
        f"the largest, {microseconds:.1f} us a query",
        held=bool(
            gaps.min() > 0.0
            and power.min() >= 0.0
            and highest <= 1.0 + 1e-9
            and np.isfinite(rendered).all()
            and abs(area - 1.0) < 1e-12
            and least > 1e-15
        ),
        figures={"area": area, "least_area": least, "highest_power": highest},
    )


def _areas(model: TextureModel) -> tuple[float, float]:
    """Return the sum and the least of the triangles' areas."""
    corners = model.vertices[model.triangulation.triangles[:, :3], :2]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    return float(areas.sum()), float(areas.min())


def _growth(many: int) -> CaseResult:
    generator = np.random.default_rng(6)
    few = many // 10
    hand = _hand(20_000)
    timed = partial(repeat, timer=time.thread_time, repeat=3, number=1)
    seconds, rendering = [], []
    for count in (few, many):
        points = generator.uniform(0.0, 1.0, (count, 2))
        seconds.append(min(timed(partial(build, points))))
        rendering.append(min(timed(partial(Synthesizer(build(points)).render, *hand))))
    allowed = 10.0 * math.log(many) / math.log(few)
    built, rendered = seconds[1] / seconds[0], rendering[1] / rendering[0]
    return CaseResult(
        f"building {built:.1f} x (n log n: {allowed:.1f}), {1e3 * seconds[1]:.0f} ms; "
        f"rendering {rendered:.2f} x",
        held=built < 1.5 * allowed and rendered < 2.0,
        figures={"building_ratio": built, "n_log_n": allowed, "rendering_ratio": rendered},
    )


def _hand(samples: int) -> tuple[FloatArray, FloatArray]:
    """Return a hand's continuous course of speed and force."""
    time_s = np.arange(samples) / 1000.0
    return 150.0 + 140.0 * np.sin(2.0 * time_s), 1.5 + 1.4 * np.cos(3.3 * time_s)


def _any_query() -> CaseResult:
    model = build(np.random.default_rng(9).uniform(0.1, 0.9, (40, 2)))
    odd = np.array([np.nan, -np.inf, -1e308, -1e-300, 0.0, 1e-300, 300.0, 1e308, np.inf])
    as_if = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 300.0, 300.0, 300.0])
    speed, force = (part.ravel() for part in np.meshgrid(odd, odd / 100.0))
    near_speed, near_force = (part.ravel() for part in np.meshgrid(as_if, as_if / 100.0))
    found, expected = model.at(speed, force), model.at(near_speed, near_force)
    off = max(float(np.abs(a - b).max()) for a, b in zip(found, expected, strict=True))
    rendered = Synthesizer(model).render(speed, force)
    return CaseResult(
        f"{len(speed)} pairs, off by {off:.0e}, rendered "
        f"{'finite' if np.isfinite(rendered).all() else 'not finite'}",
        held=off <= 1e-9 and bool(np.isfinite(rendered).all()),
        figures={"off": off},
    )


FAMILY: Final = Family("Texture models of any samples", cases)
