"""Models of velocity and force: degenerate samples, odd units and queries, either method.

The plane's cases (`mmt_lab.stability.families.model`) in three dimensions. Samples may also lie on
planes and lines that the plane does not have: one force, one heading, a ring of one speed.
"""

from functools import partial
from itertools import product
from typing import Final

import numpy as np
from scipy.spatial import ConvexHull

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_reflection
from mmt.texture.interpolation.networks import LEVEL_ROOM
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import Method
from mmt.texture.space import ANISOTROPIC, InputSpace
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.stability.degenerate import build, of_space, random_points
from mmt_lab.stability.families import CaseResult, Extreme, Family

MANY: Final = 2000
METHODS: Final[tuple[Method, ...]] = ("field", "published")

_LARGEST_NETWORK: Final = 200  # samples; a network costs their cube
_ROUNDING: Final = 1e-7  # of a level, through the gain of a nearly unstable filter
_EXPECTED: Final = "the whole space; filters ordered, level within bounds, silence at rest"


def cases(*, many: int = MANY, queries: int = 2000) -> list[Extreme]:
    """Return the family's cases."""
    scales = (1e-3, 1e3, 1e6)
    return [
        *(
            Extreme(what, _EXPECTED, partial(_space, points, queries))
            for what, points in of_space(many)
        ),
        *(
            Extreme(
                f"speeds in units {speed:g} times smaller, forces {force:g}",
                "the same model to 1e-9",
                partial(_units, speed, force),
            )
            for speed, force in zip(scales, scales[::-1], strict=True)
        ),
        *(
            Extreme(
                f"levels times {scale:g}", "the level times as much to 1e-9", partial(_level, scale)
            )
            for scale in (1e-200, 1e-30, 1e100)
        ),
        Extreme(
            "queries NaN, infinite, negative, far outside",
            "as at the end of the space with the same heading, NaN as zero",
            _any_query,
        ),
    ]


def _space(points: FloatArray, queries: int) -> CaseResult:
    """Build the model by each method, and evaluate it everywhere and at its samples."""
    asked = np.vstack([random_points(queries, np.random.default_rng(4)), points])
    least_gap, largest_k, highest, silent = np.inf, 0.0, 0.0, True
    for method in METHODS:
        if method == "published" and len(points) > _LARGEST_NETWORK:
            continue
        model = build(points, method)
        lsf, variance = model.at(*(asked * ANISOTROPIC.scale).T)
        least_gap = min(least_gap, float(np.diff(lsf, prepend=0.0, append=np.pi, axis=1).min()))
        k = lsf_to_reflection(lsf)
        largest_k = max(largest_k, float(np.abs(k).max()))
        if method == "published":
            highest = float(variance.max() / model.samples.variance.max()) / LEVEL_ROOM
        silent &= bool(np.all(variance >= 0.0)) and _is_silent_at_rest(model)
        rendered = Synthesizer(model, limit_m_s2=np.inf).render(*(asked * ANISOTROPIC.scale).T)
        if not np.isfinite(rendered).all():
            return CaseResult(f"{method}: what is rendered is not finite", held=False)
    missing = _missing_volume(build(points))
    return CaseResult(
        f"gaps from {least_gap:.0e} rad, level to {highest:.3f} of its bound, "
        f"{missing:+.0e} of the space missing",
        held=least_gap > 0.0
        and largest_k < 1.0
        and highest <= 1.0 + _ROUNDING
        and silent
        and abs(missing) < 1e-9,
        figures={"least_gap_rad": least_gap, "highest_level": highest, "missing": missing},
    )


def _is_silent_at_rest(model: TextureModel) -> bool:
    steps = np.linspace(0.0, 300.0, 50)
    at_rest = model.at(0.0, 0.0, steps / 100.0)[1]
    without_force = model.at(steps, -steps, 0.0)[1]
    return not at_rest.any() and not without_force.any()


def _missing_volume(model: TextureModel) -> float:
    """Return the share of the convex hull that no tetrahedron covers."""
    corners = model.triangulation.points[model.triangulation.triangles[:, :4]]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6.0
    return 1.0 - float(volumes.sum()) / float(ConvexHull(model.triangulation.points).volume)


def _units(per_speed: float, per_force: float) -> CaseResult:
    space = InputSpace("anisotropic", 300.0 / per_speed, 3.0 / per_force)
    points, asked = (random_points(count, np.random.default_rng(5)) for count in (60, 500))
    off = max(
        _difference(
            build(points, by).at(*(asked * ANISOTROPIC.scale).T),
            build(points, by, space).at(*(asked * space.scale).T),
        )
        for by in METHODS
    )
    return CaseResult(f"off by {off:.0e}", held=off < 1e-9, figures={"off": off})


def _level(scale: float) -> CaseResult:
    points, asked = (random_points(count, np.random.default_rng(6)) for count in (60, 500))
    off = 0.0
    for by in METHODS:
        # a field's level scales in proportion only far above imperceptible levels
        usual, times = (1.0, scale) if by == "published" else (1e20, max(scale, 1.0 / scale))
        lsf, variance = build(points, by, scale=usual * times).at(*(asked * ANISOTROPIC.scale).T)
        plain = build(points, by, scale=usual).at(*(asked * ANISOTROPIC.scale).T)
        off = max(off, _difference(plain, (lsf, variance / times)))
    return CaseResult(f"off by {off:.0e}", held=off < 1e-9, figures={"off": off})


def _difference(one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]) -> float:
    """Return how far filters are apart: LSF in rad, variances over the largest."""
    lsf = np.abs(one[0] - other[0]).max()
    return float(max(lsf, np.abs(one[1] - other[1]).max() / one[1].max()))


def _any_query() -> CaseResult:
    odd = np.array([np.nan, -np.inf, -1e308, -300.0, -1e-300, 0.0, 1e-300, 300.0, 1e308, np.inf])
    asked = np.array(list(product(odd, odd, odd / 100.0)))
    bounded = np.nan_to_num(asked, nan=0.0, posinf=1e300, neginf=-1e300)
    bounded[:, :2] = np.clip(bounded[:, :2], -3e8, 3e8)  # a million times the largest speed
    speed = np.hypot(bounded[:, 0], bounded[:, 1])
    bounded[:, :2] *= np.minimum(300.0 / np.maximum(speed, 1e-300), 1.0)[:, None]
    bounded[:, 2] = np.clip(bounded[:, 2], 0.0, 3.0)
    off, finite = 0.0, True
    for by in METHODS:
        model = build(random_points(60, np.random.default_rng(9)), by)
        off = max(off, _difference(model.at(*bounded.T), model.at(*asked.T)))
        finite &= bool(np.isfinite(Synthesizer(model).render(*asked.T)).all())
    return CaseResult(
        f"{len(asked)} moments, off by {off:.0e}, rendered {'' if finite else 'not '}finite",
        held=off < 1e-9 and finite,
        figures={"off": off},
    )


FAMILY: Final = Family("Models of velocity and force", cases)
