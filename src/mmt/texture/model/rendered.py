"""Vertices, interpolant and level of a model, by either method; computed on first use."""

from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.interpolation.delaunay import triangulate
from mmt.texture.interpolation.interpolant import Interpolant
from mmt.texture.interpolation.networks import network_arrays
from mmt.texture.interpolation.vertices import Vertices, vertex_table
from mmt.texture.linear_algebra import nearest_rows
from mmt.texture.settings import Method
from mmt.texture.space import TextureSamples

if TYPE_CHECKING:
    from mmt.texture.field.cells import FieldCells
    from mmt.texture.field.posterior import LevelField


def triangulated(vertices: Vertices) -> Interpolant:
    """Return the piecewise linear interpolant of samples and boundary; O(n log n)."""
    mesh = triangulate(vertices.points)
    return Interpolant(vertices.table, mesh.triangles, np.zeros((0, 0)))


def networked(vertices: Vertices) -> Interpolant:
    """Return the network through the vertices that are samples; O(n^3)."""
    samples = vertices.samples
    rows, tail = network_arrays(vertices.points[:samples], vertices.values[:samples])
    return Interpolant(rows, np.zeros((0, 0), dtype=np.int64), tail)


class PublishedRendered:
    """Papers A and B: linear interpolation over speed and force, a network over velocity."""

    level: "LevelField | None" = None
    """Posterior of the level; None if the interpolant gives the level."""

    def __init__(self, samples: TextureSamples, cells: "FieldCells | None", rate_hz: float) -> None:
        self._samples, self._cells, self._rate_hz = samples, cells, rate_hz

    @cached_property
    def vertices(self) -> Vertices:
        """Samples and boundary points."""
        samples = self._samples
        return vertex_table(samples.points, samples.variance, samples.lsf)

    @cached_property
    def interpolant(self) -> Interpolant:
        """Level and filter over the inputs."""
        interpolate = networked if self._samples.space.directed else triangulated
        return interpolate(self.vertices)


class FieldRendered(PublishedRendered):
    """Linear interpolation of smoothed LSF; level from the blocks, else from the samples."""

    @cached_property
    def vertices(self) -> Vertices:
        """Samples and boundary points."""
        from mmt.texture.field.shape_smoothing import smoothed_shapes

        samples = self._samples
        return vertex_table(samples.points, samples.power, smoothed_shapes(samples))

    @cached_property
    def interpolant(self) -> Interpolant:
        """Level, which is not used, and filter over the inputs."""
        return triangulated(self.vertices)

    @cached_property
    def level(self) -> "LevelField | None":  # type: ignore[override] # computed when asked for
        """Posterior of the level."""
        from mmt.texture.field.posterior import LevelField, field_of_samples

        samples, cells = self._samples, self._cells
        if cells is None:
            return field_of_samples(samples)
        gain = self._gain_at(cells.points)
        return LevelField(cells, noise_power=samples.noise_power, gain=gain)

    def _gain_at(self, points: FloatArray) -> FloatArray:
        """Return the gain (k,) that restores the power lost in the high-pass at points (k, d).

        It is computed from the nearest sample's filter.
        """
        from mmt.texture.signals.high_pass import gain_without_high_pass

        nearest = nearest_rows(self._samples.points, points)
        used = np.bincount(nearest) > 0
        gain = gain_without_high_pass(self._samples.lsf[: len(used)][used], self._rate_hz)
        return np.asarray(gain[(used.cumsum() - 1)[nearest]])


RENDERED: Final[dict[Method, type[PublishedRendered]]] = {
    "field": FieldRendered,
    "published": PublishedRendered,
}
"""Class for each method."""
