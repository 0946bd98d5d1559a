"""What a model is rendered from, by either method, and a model at another sampling rate.

The spectrum of each filter, up to the lower of both Nyquist frequencies, is that of the vibration
at the new rate, and the filter of the new order follows from its autocorrelations (Makhoul, "Linear
prediction: a tutorial review", Proc. IEEE 63 (1975), 561-580, section IV.C, selective linear
prediction). For a higher rate nothing is known above the old Nyquist frequency: there the spectrum
is set to `FLOOR_DB` below its mean, which keeps the equations well conditioned.

Errors of the shipped models converted from 1 kHz (root mean square from 10 to 490 Hz, median over
strokes): 0.5 to 0.7 dB at 2 kHz, 0.6 to 0.8 dB at 5 kHz, and 0.7 to 1.2 dB at 10 kHz, where the
memory of filters is 6 ms, not 16. Converted back, they are off by 0.2, 0.4 and 1.1 dB at most.
"""

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.spatial.distance import cdist

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.burg import period_of, reflection_of
from mmt.texture.autoregression.forms import lsf_output_power, lsf_spectrum, reflection_to_lsf
from mmt.texture.interpolation.delaunay import triangulate
from mmt.texture.interpolation.interpolant import Interpolant
from mmt.texture.interpolation.networks import network_arrays
from mmt.texture.interpolation.vertices import Vertices, vertex_table
from mmt.texture.model.file import ModelContents
from mmt.texture.settings import Method, usual_order
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
        from mmt.texture.model.fits import gain_without_high_pass

        nearest = cdist(points, self._samples.points, "sqeuclidean").argmin(axis=1)
        used = np.bincount(nearest) > 0
        gain = gain_without_high_pass(self._samples.lsf[: len(used)][used], self._rate_hz)
        return np.asarray(gain[(used.cumsum() - 1)[nearest]])


RENDERED: Final[dict[Method, type[PublishedRendered]]] = {
    "field": FieldRendered,
    "published": PublishedRendered,
}
"""Class for each method."""


FLOOR_DB: Final = 40.0
"""Depth of the spectrum below its mean where the vibration is not known. A deeper floor spends more
of the filter on the edge: of 20, 30, 40, 50, 60 and 80 dB, 40 has the least errors on HaTT."""


def resampled(contents: ModelContents, rate_hz: float) -> ModelContents:
    """Return a model's contents at another sampling rate.

    Powers are those within the new band. Cost: up to 1 ms a sample from 1 kHz, some ms from 10 kHz.
    """
    samples, ratio = contents.samples, rate_hz / contents.rate_hz
    density, share = _spectra(samples.lsf, contents.rate_hz, rate_hz)
    reflection, _ = reflection_of(density, usual_order(rate_hz))
    power = samples.power * share
    field = contents.field
    if field is not None:
        nearest = cdist(field.points, samples.points, "sqeuclidean").argmin(axis=1)
        field = field.scaled(share[nearest][field.cell_of_row])
    resized = replace(
        samples,
        lsf=reflection_to_lsf(reflection),
        variance=power * np.prod((1.0 - reflection) * (1.0 + reflection), axis=1),
        power=power,
        noise_power=samples.noise_power * min(ratio, 1.0),
        counts=None if samples.counts is None else samples.counts * ratio,
    )
    touch_down = contents.touch_down
    if touch_down is not None:
        touch_down = touch_down.at_rate(contents.rate_hz, rate_hz)
    return ModelContents(resized, contents.method, rate_hz, field, touch_down)


def _spectra(lsf: FloatArray, before_hz: float, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Return spectra (k, f) at the new rate, and the share of the power that is in its band, (k,).

    The spectra are of filters (k, m), for white noise of variance one.
    """
    frequencies_hz = np.linspace(0.0, 0.5 * rate_hz, period_of(rate_hz) // 2 + 1)
    known = frequencies_hz <= 0.5 * before_hz
    known_hz = frequencies_hz[known]
    density = np.empty((len(lsf), len(known)))
    for row, filter_lsf in enumerate(lsf):  # in one call they would fill the memory
        density[row, known] = lsf_spectrum(filter_lsf, 1.0, known_hz, before_hz)
    floor = 10.0 ** (-FLOOR_DB / 10.0)
    density[:, ~known] = floor * density[:, known].mean(axis=1, keepdims=True)
    if rate_hz >= before_hz:
        return density, np.ones(len(lsf))
    power = lsf_output_power(np.ones(len(lsf)), lsf)
    return density, np.minimum(np.trapezoid(density, frequencies_hz, axis=1) / power, 1.0)
