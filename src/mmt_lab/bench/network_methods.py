"""Ways to interpolate a texture's samples that a bench of networks compares."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.interpolate import LinearNDInterpolator, RBFInterpolator

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_reflection
from mmt.texture.interpolation.radial_basis.evaluation import least_gap, nearest_valid_lsf
from mmt.texture.interpolation.vertices import vertex_table
from mmt.texture.model.samples import TextureSamples
from mmt.texture.model.texture_model import TextureModel

Filters = tuple[FloatArray, FloatArray]
"""Line spectral frequencies (k, m) and variances (k,)."""


@dataclass(frozen=True)
class Method:
    """A way to interpolate.

    Attributes
    ----------
    build
        From samples to what is asked later.
    add
        From what was built and all samples, one of them new, to what is asked later.
    ask
        From what was built and inputs (k, d) to whatever the method returns.
    filters
        From the samples and what `ask` returned to valid filters; not timed.
    """

    build: Callable[[TextureSamples], Any]
    add: Callable[[Any, TextureSamples], Any]
    ask: Callable[[Any, FloatArray], Any]
    filters: Callable[[TextureSamples, Any], Filters]


def part_of(samples: TextureSamples, count: int) -> TextureSamples:
    """Return the first samples."""
    return TextureSamples(
        samples.inputs[:count],
        samples.lsf[:count],
        samples.variance[:count],
        samples.power[:count],
        samples.space,
    )


def _own(interpolator: str) -> Method:
    def build(samples: TextureSamples) -> TextureModel:
        return TextureModel(samples, interpolator=interpolator)

    def add(model: TextureModel, samples: TextureSamples) -> TextureModel:
        return TextureModel(samples, interpolator=interpolator, previous=model)

    def ask(model: TextureModel, inputs: FloatArray) -> Filters:
        return model.at(*inputs.T)

    return Method(build, add, ask, lambda _, filters: filters)


def _anew(build: Callable[[TextureSamples], Any]) -> Callable[[Any, TextureSamples], Any]:
    return lambda _, samples: build(samples)


def _scipy_radial(samples: TextureSamples) -> tuple[TextureSamples, RBFInterpolator]:
    values = np.column_stack([samples.power, samples.lsf])
    return samples, RBFInterpolator(samples.points, values)


def _scipy_linear(samples: TextureSamples) -> tuple[TextureSamples, LinearNDInterpolator]:
    vertices = vertex_table(samples.points, samples.power, samples.lsf)
    return samples, LinearNDInterpolator(vertices.points, vertices.values)


def _ask_scipy(built: tuple[TextureSamples, Callable[..., Any]], inputs: FloatArray) -> FloatArray:
    samples, interpolator = built
    return np.asarray(interpolator(samples.space.normalise(inputs)))


def _made_valid(samples: TextureSamples, values: FloatArray) -> Filters:
    """Return filters of power and LSF (k, 1 + m), by the projection that ours are made by."""
    gap = least_gap(samples.lsf)
    lowest, highest = samples.lsf.min(axis=0), samples.lsf.max(axis=0)
    lsf = np.ascontiguousarray(values[:, 1:])
    for row in lsf:
        nearest_valid_lsf(row, gap, lowest, highest, np.empty(3 * len(row)))
    power = np.maximum(values[:, 0], 1e-3 * samples.power.min())  # a zero has no error in dB
    return lsf, power * np.prod(1.0 - lsf_to_reflection(lsf) ** 2, axis=1)


OURS: Final = "mmt, radial basis"
DELAUNAY: Final = "mmt, Delaunay"
SCIPY_RADIAL: Final = "scipy RBFInterpolator"
SCIPY_LINEAR: Final = "scipy LinearNDInterpolator"

METHODS: Final[Mapping[str, Method]] = {
    OURS: _own("rbf"),
    DELAUNAY: _own("delaunay"),
    SCIPY_RADIAL: Method(_scipy_radial, _anew(_scipy_radial), _ask_scipy, _made_valid),
    SCIPY_LINEAR: Method(_scipy_linear, _anew(_scipy_linear), _ask_scipy, _made_valid),
}
