"""The texture model: autoregressive filters over the inputs of a hand.

Awan et al., section V.B: the samples' filters, kept as line spectral frequencies (LSF), stand
at their mean speed and force, both divided by their maxima; the plane is Delaunay
triangulated, extended by boundary points on its four edges. Abdulali and Jeon (paper B): in
place of the speed, the velocity vector. What differs between the two is the input space
(`mmt.texture.model.inputs`) and the interpolator (`mmt.texture.interpolation.registry`). A
model never changes: modelling builds a new one and hands it over by one assignment.
"""

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Self, cast, get_args

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.bounds import RateHz, check
from mmt.core.errors import InputError
from mmt.models import find_model
from mmt.texture.autoregression.forms import lsf_to_reflection
from mmt.texture.autoregression.spectra import lsf_spectrum
from mmt.texture.field.level_table import TABLE, TABLE_SIZES
from mmt.texture.field.trend import NO_TREND, fit_trend, without_trend
from mmt.texture.interpolation.delaunay import Triangulation, triangulate
from mmt.texture.interpolation.interpolator import Interpolant
from mmt.texture.interpolation.registry import WITHOUT_TREND, load
from mmt.texture.interpolation.vertices import vertex_table
from mmt.texture.model.file import FittedParameters, ModelContents, pack, unpack
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.kernel_parameters import (
    DIMENSIONS,
    FORCE_EXPONENT,
    LEVEL_KIND,
    LEVELS,
    MODEL_ORDER,
    PER_FORCE,
    PER_SPEED,
    SPEED_EXPONENT,
    filters_into,
)
from mmt.texture.model.samples import TextureSamples
from mmt.texture.settings import Interpolated, Level, Shape

if TYPE_CHECKING:
    from mmt.texture.field.cells import FieldCells
    from mmt.texture.field.posterior import LevelField

__all__ = ["LEVELS", "TextureModel", "TextureSamples", "load_model"]


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
        How: a name known to `mmt.texture.interpolation.registry`.
    level
        What the level follows: ``"interpolated"`` as said above, or ``"gaussian_process"``, the
        posterior mean of `mmt.texture.field.posterior`, for which `interpolate` is ``"power"``.
    shape
        Whether the spectra are those of the samples, ``"measured"``, or ``"smoothed"`` over all of
        them by `mmt.texture.field.shape_smoothing`. The latter are samples of the vibration before
        the modelling's high-pass (`mmt.texture.model.fits`), and blocks get their powers back.
    field
        Blocks by which the level is estimated; None for the samples alone.
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
        inside (0, pi), there is no such interpolation or level, or the two exclude each other.
    """

    def __init__(
        self,
        samples: TextureSamples,
        *,
        interpolate: Interpolated = "power",
        interpolator: str = "delaunay",
        level: Level = "interpolated",
        shape: Shape = "measured",
        field: "FieldCells | None" = None,
        rate_hz: float = 1000.0,
        previous: "TextureModel | None" = None,
        fitted: FittedParameters | None = None,
    ) -> None:
        for name, value, allowed in (
            ("interpolate", interpolate, list(LEVELS)),
            ("level", level, get_args(Level)),
            ("shape", shape, get_args(Shape)),
        ):
            if value not in allowed:
                raise InputError(f"{name} is {value!r}, allowed are {', '.join(allowed)}")
        if level != "interpolated" and interpolate != "power":
            raise InputError(f'level {level!r} needs interpolate "power", not {interpolate!r}')
        build = load(interpolator)
        samples.check()
        check("rate_hz", rate_hz, RateHz)
        self.samples = samples.frozen()
        self.interpolate: Interpolated = interpolate
        self.interpolator = interpolator
        self.rate_hz = float(rate_hz)
        self.points = self.samples.points
        self.points.setflags(write=False)
        self.level: Level = level
        self.shape: Shape = shape
        values = {
            "variance": self.samples.variance,
            "power": self.samples.power,
            "amplitude": np.sqrt(self.samples.power),
        }[interpolate]
        self.trend = NO_TREND
        if self.space.directed and interpolator not in WITHOUT_TREND:
            is_amplitude = interpolate == "amplitude"
            self.trend = (
                fitted.trend
                if fitted
                else fit_trend(self.points, values, is_amplitude=is_amplitude)
            )
            values = without_trend(self.points, values, self.trend)
        inside = (level, shape) == ("gaussian_process", "smoothed")
        lsf = self._lsf(inside=inside)
        vertices = vertex_table(self.points, values, lsf, inside=inside)
        self.vertices = vertices.table
        self.dimensions = self.space.dimensions
        grown = previous is not None and previous._alike == self._alike
        self.interpolant: Interpolant = build(
            vertices,
            previous.interpolant if previous is not None and grown else None,
            fitted.interpolator_state if fitted else None,
        )
        self.field = field if field is None or len(field) else None
        """What the level is estimated from, beside the samples."""
        if level == "gaussian_process":
            _ = self.kernel_parameters  # made now, where modelling has the time

    def __repr__(self) -> str:
        samples, space = self.samples, self.space
        speeds = f"{samples.speed_mm_s.min():.3g} to {samples.speed_mm_s.max():.3g} mm/s"
        forces = f"{samples.force_n.min():.3g} to {samples.force_n.max():.3g} N"
        return (
            f"<TextureModel: {space.name}, {len(samples)} samples of order {self.order} at "
            f"{self.rate_hz:g} Hz, {speeds}, {forces}, interpolator {self.interpolator}, "
            f"level {self.level}, shape {self.shape}>"
        )

    @property
    def fitted(self) -> FittedParameters:
        """The parameters that were fitted to the samples."""
        return FittedParameters(self.trend, self.interpolant.state())

    @cached_property
    def kernel_parameters(self) -> FloatArray:
        """What kernels need beside the interpolant; see `mmt.texture.model.kernel_parameters`."""
        field = self.level_field if self.level == "gaussian_process" else None
        table = np.zeros((0, 0, 0)) if field is None else field.table
        parameters = np.empty(TABLE + table.size)
        parameters[TABLE_SIZES:TABLE], parameters[TABLE:] = table.shape, table.ravel()
        parameters[LEVEL_KIND] = LEVELS[self.interpolate]
        parameters[SPEED_EXPONENT], parameters[FORCE_EXPONENT] = self.trend
        parameters[PER_SPEED] = 1.0 / self.space.maximum_speed_mm_s
        parameters[PER_FORCE] = 1.0 / self.space.maximum_force_n
        parameters[DIMENSIONS], parameters[MODEL_ORDER] = self.dimensions, self.order
        return parameters

    @cached_property
    def level_field(self) -> "LevelField | None":
        """The level with its uncertainty, whatever is rendered; None where nothing has power.

        By the blocks of `field`, or without them by the samples.
        """
        from mmt.texture.field.posterior import LevelField, field_of_samples

        if self.field is None:
            return field_of_samples(self.samples)
        gain = self._gain_at(self.field.points)
        return LevelField(self.field, noise_power=self.samples.noise_power, gain=gain)

    def level_db(self, *inputs: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation of the level in dB, each of shape (k,).

        They are those of `level_field`, 0 dB being 1 (m/s2)^2, which every model has: with a
        level of ``"gaussian_process"`` the mean is what is rendered; an ``"interpolated"`` one
        goes through the samples, scatter and all, and may be off this mean by the deviation.

        Parameters
        ----------
        *inputs
            Those of `at`.

        Raises
        ------
        InputError
            There are not d inputs, or no sample has any power.
        """
        points = self.space.normalise(self.space.stack(*inputs))
        if self.level_field is None:
            raise InputError("no sample of the model has any power: its level has no logarithm")
        return self.level_field.level_db(points)

    def _gain_at(self, points: FloatArray) -> FloatArray:
        """Return what the power that was felt at points (k, d) lacks by the high-pass, (k,).

        By the nearest filter; 1 where the filters are as measured, too.
        """
        if self.shape == "measured":
            return np.ones(len(points))
        from mmt.texture.signals.high_pass import gain_without_high_pass

        place, lsf = np.split(self.vertices, [self.dimensions + 1], axis=1)
        gain = gain_without_high_pass(lsf_to_reflection(np.ascontiguousarray(lsf)), self.rate_hz)
        nearest = cKDTree(place[:, : self.dimensions]).query(points)[1]
        return np.asarray(gain[nearest])

    def _lsf(self, *, inside: bool) -> FloatArray:
        """Return the frequencies at the samples, and around them where they are smoothed."""
        if self.shape == "measured":
            return self.samples.lsf
        from mmt.texture.field.shape_smoothing import smoothed_shapes

        return smoothed_shapes(self.samples, inside=inside)

    @property
    def _alike(self) -> tuple[object, ...]:
        """What an earlier model must share to be grown from."""
        return self.space, self.interpolate, self.interpolator, self.shape, self.order

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
        points = np.ascontiguousarray(self.vertices[:, : self.dimensions])
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
        address, parameters = by.evaluator.address, self.kernel_parameters
        filters_into(address, by.rows, by.links, by.tail, parameters, points, lsf, variance)
        return lsf, variance

    def spectrum(self, *inputs: npt.ArrayLike, frequencies_hz: FloatArray) -> FloatArray:
        """Return the one-sided power spectral density in (m/s2)^2/Hz, shape (k, f).

        Parameters
        ----------
        *inputs
            Those of `at`.
        frequencies_hz
            Shape (f,), from 0 to half the sampling rate.

        Raises
        ------
        InputError
            There are not d inputs.
        """
        lsf, variance = self.at(*inputs)
        return lsf_spectrum(lsf, variance, frequencies_hz, self.rate_hz)

    def save(self, path: str | Path) -> None:
        """Write the model as ``.npz``; the layout is in ``docs/reference/model-file.md``."""
        Path(path).write_bytes(self.to_bytes())

    def to_bytes(self) -> bytes:
        """Return what `save` writes."""
        return pack(self.contents)

    @property
    def contents(self) -> ModelContents:
        """What its file holds."""
        return ModelContents(
            self.samples,
            self.interpolate,
            self.interpolator,
            self.level,
            self.shape,
            self.rate_hz,
            self.fitted,
            self.field,
        )

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote, now or in an earlier version.

        Raises
        ------
        InputError
            The file is missing, is no model, has another version, or holds bad numbers.
        """
        try:
            return cls.from_bytes(Path(path).read_bytes())
        except OSError as error:
            raise InputError(f"model {path}: {error.strerror or error}") from error
        except InputError as error:
            raise InputError(f"model {path}: {error}") from error

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """Rebuild a model from `to_bytes`; raises `InputError` as `load` does."""
        return cls.from_contents(unpack(data))

    @classmethod
    def from_contents(cls, contents: ModelContents) -> Self:
        """Rebuild a model from `contents`; raises `InputError` as the constructor does."""
        return cls(
            contents.samples,
            interpolate=cast(Interpolated, contents.interpolate),  # names are checked there
            interpolator=contents.interpolator,
            level=cast(Level, contents.level),
            shape=cast(Shape, contents.shape),
            field=contents.field,
            rate_hz=contents.rate_hz,
            fitted=contents.fitted,
        )


def load_model(source: str | Path) -> TextureModel:
    """Load a texture model: a shipped one by its name, or a ``.npz`` file.

    Raises
    ------
    InputError
        It is neither, or the file is not a texture model; the message lists the shipped names.

    Examples
    --------
    >>> import mmt
    >>> import numpy as np
    >>> model = mmt.load_model("oak")
    >>> vibration_m_s2 = mmt.Synthesizer(model, seed=1).render(np.full(500, 100.0), np.ones(500))
    >>> vibration_m_s2.shape
    (500,)
    """
    return TextureModel.load(find_model(Path(source)))
