"""The texture model: autoregressive filters over the inputs of a hand.

Awan et al., section V.B: the samples' filters, kept as line spectral frequencies (LSF), stand
at their mean speed and force, both divided by their maxima; the plane is Delaunay
triangulated, extended by boundary points on its four edges. Abdulali and Jeon (paper B): in
place of the speed, the velocity vector. What differs between the two is the input space
(`mmt.texture.inputs`) and the interpolator (`mmt.texture.interpolators`). A model never
changes: modelling builds a new one and hands it over by one assignment.
"""

from functools import cached_property
from pathlib import Path
from typing import Final, Self

import numpy as np
import numpy.typing as npt

from mmt.arrays import FloatArray, IntArray
from mmt.compiled import kernel
from mmt.errors import InputError
from mmt.texture.fitted import Fitted
from mmt.texture.inputs import InputSpace
from mmt.texture.interpolation import Triangulation, triangulate
from mmt.texture.interpolators import (
    BUILDERS,
    DELAUNAY,
    LARGEST_SCRATCH,
    Interpolant,
    evaluate_into,
    planar_into,
)
from mmt.texture.lsf import lsf_inverse_gain
from mmt.texture.model_file import pack, unpack
from mmt.texture.samples import TextureSamples
from mmt.texture.settings import Interpolated, Interpolation
from mmt.texture.spectra import lsf_spectrum
from mmt.texture.trend import NO_TREND, fit_trend, trend_at, without_trend
from mmt.texture.vertices import vertex_table

__all__ = ["LEVELS", "TextureModel", "TextureSamples"]

LEVELS: Final[dict[Interpolated, int]] = {"variance": 0, "power": 1, "amplitude": 2}
"""What is interpolated linearly, by its number in the compiled kernels."""

KIND, LEVEL_KIND, SPEED_EXPONENT, FORCE_EXPONENT, PER_SPEED, PER_FORCE = range(6)
DIMENSIONS, MODEL_ORDER, LAW_SIZE = 6, 7, 8
"""Places in `TextureModel.law`: one array costs a compiled call less than eight numbers."""


class TextureModel:
    """An immutable model: ask it for a filter or a spectrum at any inputs.

    Parameters
    ----------
    samples
        At least one; copied. A sample beyond the end of its space counts as lying there.
    interpolate
        What is interpolated beside the LSF: ``"variance"`` of the excitation (the published
        way), ``"power"`` of the vibration, or its ``"amplitude"``, the root of the power.
        With the latter two the variance follows from the interpolated filter's own gain.
    interpolator
        How: one of `mmt.texture.interpolators.BUILDERS`.
    rate_hz
        Sampling rate of the filters.
    previous
        An earlier state of the same model, from which some interpolators grow at less cost.
    fitted
        What `fitted` was of a model of the same samples: nothing is fitted or chosen anew.

    Raises
    ------
    InputError
        Shapes disagree, a number is not finite or negative, an LSF set is not ascending
        inside (0, pi), or there is no such interpolation.
    """

    def __init__(
        self,
        samples: TextureSamples,
        *,
        interpolate: Interpolated = "power",
        interpolator: Interpolation = "delaunay",
        rate_hz: float = 1000.0,
        previous: "TextureModel | None" = None,
        fitted: Fitted | None = None,
    ) -> None:
        for name, value, allowed in (
            ("interpolate", interpolate, list(LEVELS)),
            ("interpolator", interpolator, list(BUILDERS)),
        ):
            if value not in allowed:
                raise InputError(f"{name} is {value!r}, allowed are {', '.join(allowed)}")
        samples.check()
        self.samples = samples.frozen()
        self.interpolate: Interpolated = interpolate
        self.interpolator: Interpolation = interpolator
        self.rate_hz = float(rate_hz)
        self.points = self.samples.points
        self.points.setflags(write=False)
        level = {
            "variance": self.samples.variance,
            "power": self.samples.power,
            "amplitude": np.sqrt(self.samples.power),
        }[interpolate]
        self.trend = NO_TREND
        if self.space.directed:
            is_amplitude = interpolate == "amplitude"
            self.trend = (
                fitted.trend if fitted else fit_trend(self.points, level, is_amplitude=is_amplitude)
            )
            level = without_trend(self.points, level, self.trend)
        self.vertices, samples_alone = vertex_table(self.points, level, self.samples.lsf)
        dimensions = self.space.dimensions
        grown = previous is not None and previous._alike == self._alike
        self.interpolant: Interpolant = BUILDERS[interpolator](
            self.vertices[:, :dimensions],
            self.vertices[:, dimensions:],
            samples_alone,
            previous.interpolant if previous is not None and grown else None,
            fitted.networks if fitted else (),
        )

    @property
    def fitted(self) -> Fitted:
        """What was found in the samples."""
        return Fitted(self.trend, self.interpolant.networks)

    @cached_property
    def law(self) -> FloatArray:
        """What the rendering needs beside the interpolant's arrays, by the numbers below."""
        law = np.empty(LAW_SIZE)
        law[KIND], law[LEVEL_KIND] = self.interpolant.kind, LEVELS[self.interpolate]
        law[SPEED_EXPONENT], law[FORCE_EXPONENT] = self.trend
        law[PER_SPEED] = 1.0 / self.space.maximum_speed_mm_s
        law[PER_FORCE] = 1.0 / self.space.maximum_force_n
        law[DIMENSIONS], law[MODEL_ORDER] = self.space.dimensions, self.order
        return law

    @property
    def _alike(self) -> tuple[object, ...]:
        """What an earlier model must share to be grown from."""
        return self.space, self.interpolate, self.interpolator, self.order

    @property
    def space(self) -> InputSpace:
        """What the model is a function of."""
        return self.samples.space

    @property
    def order(self) -> int:
        """The order that all filters share."""
        return int(self.samples.lsf.shape[1])

    @property
    def triangles(self) -> IntArray:
        """Corners and neighbours, shape (t, 2 (d + 1)); see `Triangulation`."""
        return self.triangulation.triangles

    @cached_property
    def triangulation(self) -> Triangulation:
        """The triangulation of samples and boundary points, whatever the interpolator."""
        points = np.ascontiguousarray(self.vertices[:, : self.space.dimensions])
        if self.interpolator == "delaunay":
            return Triangulation(points, self.interpolant.links)
        return triangulate(points)

    def at(self, *inputs: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Interpolate the filter.

        Parameters
        ----------
        *inputs
            The d inputs of the model's space, speed and force or velocity x, y and force;
            each of shape (k,) or a scalar. Beyond the end of the space they count as lying
            there, NaN counts as zero.

        Returns
        -------
        lsf, variance
            Shapes (k, order) and (k,).

        Raises
        ------
        InputError
            There are not d inputs.
        """
        points = np.ascontiguousarray(self.space.normalise(self.space.stack(*inputs)))
        lsf, variance = np.empty((len(points), self.order)), np.empty(len(points))
        by = self.interpolant
        _filters_into(by.rows, by.links, by.tail, self.law, points, lsf, variance)
        return lsf, variance

    def spectrum(self, *inputs: npt.ArrayLike, frequencies_hz: FloatArray) -> FloatArray:
        """Return the one-sided power spectral density in (m/s2)^2/Hz, shape (k, f).

        The inputs are those of `at`.
        """
        lsf, variance = self.at(*inputs)
        return lsf_spectrum(lsf, variance, frequencies_hz, self.rate_hz)

    def save(self, path: Path) -> None:
        """Write the model as ``.npz``; the layout is in ``docs/reference/model-file.md``."""
        path.write_bytes(self.to_bytes())

    def to_bytes(self) -> bytes:
        """Return what `save` writes."""
        return pack(self)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what `save` wrote, now or in an earlier version.

        Raises
        ------
        InputError
            The file is missing, is no model, has another version, or holds bad numbers.
        """
        try:
            return cls.from_bytes(path.read_bytes())
        except OSError as error:
            raise InputError(f"model {path}: {error.strerror or error}") from error
        except InputError as error:
            raise InputError(f"model {path}: {error}") from error

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """Rebuild a model from `to_bytes`; raises `InputError` as `load` does."""
        samples, settings = unpack(data)
        return cls(samples, **settings)


@kernel("void(f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[::1])")
def _filters_into(
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    law: FloatArray,
    points: FloatArray,
    lsf: FloatArray,
    variance: FloatArray,
) -> None:
    """Write LSF (k, m) and excitation variances (k,) at points.

    The gain of a mean of LSF is no mean of gains.
    """
    kind, level_kind, place = int(law[KIND]), int(law[LEVEL_KIND]), 0
    work, values = np.empty(LARGEST_SCRATCH), np.empty(1 + lsf.shape[1])
    planar = kind == DELAUNAY and points.shape[1] == 2
    for row in range(len(points)):
        if planar:
            x, y = points[row, 0], points[row, 1]
            place = planar_into(rows, links, place, x, y, values, work)
        else:
            place = evaluate_into(kind, rows, links, tail, place, points[row], values, work)
        for k in range(lsf.shape[1]):
            lsf[row, k] = values[1 + k]
        level = values[0]
        if law[SPEED_EXPONENT] > 0.0:
            level *= trend_at(law[SPEED_EXPONENT], law[FORCE_EXPONENT], points[row])
        if level_kind != 0 and level != 0.0:
            if level_kind == 2:
                level *= level
            level *= lsf_inverse_gain(lsf[row], work)
        variance[row] = level
