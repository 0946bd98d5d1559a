"""What a model renders from its samples, by either method."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_reflection
from mmt.texture.interpolation.interpolant import Interpolant, networked, triangulated
from mmt.texture.interpolation.vertices import Vertices, vertex_table
from mmt.texture.model.samples import TextureSamples
from mmt.texture.settings import Method

if TYPE_CHECKING:
    from mmt.texture.field.cells import FieldCells
    from mmt.texture.field.posterior import LevelField


class Rendered(NamedTuple):
    """What a model renders from.

    Attributes
    ----------
    vertices
        Samples and boundary points.
    interpolate
        From these to level and filter over the inputs.
    level
        Posterior of the level's logarithm in place of the interpolant's level, None for the
        latter.
    """

    vertices: Vertices
    interpolate: Callable[[Vertices], Interpolant]
    level: "LevelField | None" = None


def published(samples: TextureSamples, cells: "FieldCells | None", rate_hz: float) -> Rendered:
    """Return LSF and variance linear over speed and force, or the network over velocity and force.

    Papers A and B; neither knows the blocks.
    """
    del cells, rate_hz
    vertices = vertex_table(samples.points, samples.variance, samples.lsf)
    return Rendered(vertices, networked if samples.space.directed else triangulated)


def field(samples: TextureSamples, cells: "FieldCells | None", rate_hz: float) -> Rendered:
    """Return LSF linear between smoothed ones, and the level of the blocks, or of the samples."""
    from mmt.texture.field.posterior import LevelField, field_of_samples
    from mmt.texture.field.shape_smoothing import smoothed_shapes

    lsf = smoothed_shapes(samples, inside=True)
    vertices = vertex_table(samples.points, samples.power, lsf, inside=True)
    if cells is None:
        level = field_of_samples(samples)
    else:
        gain = _gain_at(cells.points, vertices, rate_hz)
        level = LevelField(cells, noise_power=samples.noise_power, gain=gain)
    return Rendered(vertices, triangulated, level)


def _gain_at(points: FloatArray, vertices: Vertices, rate_hz: float) -> FloatArray:
    """Return what the power that was felt at points (k, d) lacks by the high-pass, (k,).

    By the nearest filter.
    """
    from mmt.texture.signals.high_pass import gain_without_high_pass

    lsf = np.ascontiguousarray(vertices.values[:, 1:])
    gain = gain_without_high_pass(lsf_to_reflection(lsf), rate_hz)
    return np.asarray(gain[cKDTree(vertices.points).query(points)[1]])


RENDERED: Final[dict[Method, Callable[..., Rendered]]] = {"field": field, "published": published}
"""From samples, blocks or None, and sampling rate (Hz) to what is rendered, by method."""
