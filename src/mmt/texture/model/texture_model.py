"""The texture model: autoregressive filters over the inputs of a hand.

Awan et al. (paper A), section V.B: the filters of samples, as line spectral frequencies (LSF), lie
at the samples' mean speed and force, both divided by their maxima. The plane is Delaunay
triangulated, extended by boundary points on its four edges. Abdulali and Jeon (paper B) use the
velocity vector in place of the speed. `mmt.texture.model.rendered` computes what is rendered, for
either method. A model never changes: modelling replaces it by a new one in one assignment.
"""

import importlib
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray
from mmt.core.bounds import RateHz, check
from mmt.core.errors import InputError, naming
from mmt.core.files.existing import replacing
from mmt.core.output.plottable import Plottable
from mmt.texture.interpolation.interpolant import (
    DIMENSIONS,
    MODEL_ORDER,
    PER_FORCE,
    PER_SPEED,
    TABLE,
    TABLE_SIZES,
    Interpolant,
    filters_into,
)
from mmt.texture.model.file import ModelContents, arrays_of, unpack
from mmt.texture.model.file_arrays import pack_arrays
from mmt.texture.settings import METHODS, Method
from mmt.texture.space import InputSpace, TextureSamples

if TYPE_CHECKING:
    from mmt.texture.field.cells import FieldCells
    from mmt.texture.field.posterior import LevelField
    from mmt.texture.interpolation.delaunay import Triangulation
    from mmt.texture.model.rendered import PublishedRendered
    from mmt.texture.touch_down.transient import Transient

__all__ = ["TextureModel", "TextureSamples", "load_model"]

# What builds models is imported where it is used: rendering a model that the modelling process has
# built needs none of it.

_PREPARED: Final = ("interpolant", "kernel_parameters")
"""Attributes that rendering needs."""


class TextureModel(Plottable):
    """Immutable texture model, which gives a filter or a spectrum at any inputs.

    Parameters
    ----------
    samples
        At least one; copied. A sample outside its space counts as lying on the space's edge.
    method
        ``"published"``: LSF and the excitation's variance are interpolated linearly between the
        samples, or by a network over velocity and force. ``"field"``: smoothed LSF are interpolated
        linearly, and the level is the posterior mean of a Gaussian process. Its samples are of the
        vibration before the modelling's high-pass (`mmt.texture.model.fits`).
    field
        Blocks from which ``"field"`` estimates the level; None to use the samples.
    rate_hz
        Sampling rate of the filters, that of the vibration.
    touch_down
        Transient of a touch-down, at that rate; None if none was learnt.
    at_once
        Whether to compute all that rendering needs now, instead of on first use.

    Raises
    ------
    InputError
        Shapes disagree, a number is not finite or negative, an LSF set is not ascending
        inside (0, pi), or there is no such method.
    """

    def __init__(
        self,
        samples: TextureSamples,
        *,
        method: Method = "field",
        field: "FieldCells | None" = None,
        rate_hz: float = 1000.0,
        touch_down: "Transient | None" = None,
        at_once: bool = True,
    ) -> None:
        if method not in METHODS:
            raise InputError(f"method is {method!r}, allowed are {', '.join(METHODS)}")
        samples.check()
        check("rate_hz", rate_hz, RateHz)
        self.samples = samples.frozen()
        self.method: Method = method
        self.rate_hz = float(rate_hz)
        self.field = field if field is None or len(field) else None
        """Blocks from which the level is estimated; None if there are none."""
        self.touch_down = touch_down
        """Transient of a touch-down, or None; see `mmt.texture.touch_down`."""
        if touch_down is not None:
            touch_down.check()
        self.points = self.samples.points
        self.points.setflags(write=False)
        self.dimensions = self.space.dimensions
        if at_once:
            self.prepared()

    @cached_property
    def rendered(self) -> "PublishedRendered":
        """Vertices, interpolant and level from which the model renders."""
        from mmt.texture.model.rendered import RENDERED

        return RENDERED[self.method](self.samples, self.field, self.rate_hz)

    def at_rate(self, rate_hz: float) -> "TextureModel":
        """Return the model converted to a sampling rate, or itself if that is its rate.

        Rendered spectra agree up to the lower of both Nyquist frequencies; above it there is next
        to nothing. See `mmt.texture.model.rendered` for the method and its errors.
        """
        check("rate_hz", rate_hz, RateHz)
        if rate_hz == self.rate_hz:
            return self
        from mmt.texture.model.rendered import resampled

        return TextureModel.from_contents(resampled(self.contents, float(rate_hz)))

    def __repr__(self) -> str:
        samples, space = self.samples, self.space
        speeds = f"{samples.speed_mm_s.min():.3g} to {samples.speed_mm_s.max():.3g} mm/s"
        forces = f"{samples.force_n.min():.3g} to {samples.force_n.max():.3g} N"
        return (
            f"<TextureModel: {space.name}, {len(samples)} samples of order {self.order} at "
            f"{self.rate_hz:g} Hz, {speeds}, {forces}, method {self.method}>"
        )

    def _repr_html_(self) -> str | None:
        page: str | None = importlib.import_module("mmt.web.texture_page").playing_element(self)
        return page

    @property
    def vertices(self) -> FloatArray:
        """Points, level and LSF of samples and boundary points; see `Vertices`."""
        if self.interpolant.is_network:
            return self.rendered.vertices.table
        return self.interpolant.rows

    @cached_property
    def interpolant(self) -> Interpolant:
        """Interpolant of the filters, and of the level unless a table gives it."""
        return self.rendered.interpolant

    @cached_property
    def kernel_parameters(self) -> FloatArray:
        """Parameters of kernels, see `mmt.texture.interpolation.interpolant`."""
        level = self.rendered.level
        table = np.zeros((0, 0, 0)) if level is None else level.table
        parameters = np.empty(TABLE + table.size)
        parameters[TABLE_SIZES:TABLE], parameters[TABLE:] = table.shape, table.ravel()
        parameters[PER_SPEED] = 1.0 / self.space.maximum_speed_mm_s
        parameters[PER_FORCE] = 1.0 / self.space.maximum_force_n
        parameters[DIMENSIONS], parameters[MODEL_ORDER] = self.dimensions, self.order
        return parameters

    def prepared(self) -> Self:
        """Compute all that rendering needs, and return the model."""
        for name in _PREPARED:
            getattr(self, name)
        return self

    @cached_property
    def level_field(self) -> "LevelField | None":
        """Level with its uncertainty, for either method; None if no sample has any power.

        It is estimated from the blocks of `field`, or from the samples if there are none.
        """
        if self.method == "field":
            return self.rendered.level
        from mmt.texture.field.posterior import field_of_samples

        return field_of_samples(self.samples)

    def level_db(self, *inputs: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation of the level in dB, each of shape (k,).

        Both are those of `level_field`; 0 dB is 1 (m/s2)^2. The method ``"field"`` renders this
        mean. The level of ``"published"`` goes through the samples with their scatter, and may
        differ from this mean by the deviation.

        Parameters
        ----------
        *inputs
            As for `at`.

        Raises
        ------
        InputError
            There are not d inputs, or no sample has any power.
        """
        points = self.space.normalise(self.space.stack(*inputs))
        if self.level_field is None:
            raise InputError("no sample of the model has any power: its level has no logarithm")
        return self.level_field.level_db(points)

    @property
    def space(self) -> InputSpace:
        """Input space of the model."""
        return self.samples.space

    @property
    def order(self) -> int:
        """The order that all filters share."""
        return int(self.samples.lsf.shape[1])

    @cached_property
    def triangulation(self) -> "Triangulation":
        """The triangulation of samples and boundary points, also for a network."""
        from mmt.texture.interpolation.delaunay import Triangulation, triangulate

        points = np.ascontiguousarray(self.vertices[:, : self.dimensions])
        if self.interpolant.is_network:
            return triangulate(points)
        return Triangulation(points, self.interpolant.links)

    def at(self, *inputs: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Interpolate the filter.

        Parameters
        ----------
        *inputs
            The d inputs of the model's space, speed and force or velocity x, y and force;
            each of shape (k,) or a scalar. Inputs outside the space count as lying on its
            edge, NaN counts as zero.

        Returns
        -------
        lsf, variance
            Shapes (k, order) and (k,).

        Raises
        ------
        InputError
            There are not d inputs.
        """
        lsf, variance, _ = self.filters(*inputs)
        return lsf, variance

    def filters(self, *inputs: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what `at` returns, and the power of the vibration, the filter's output, (k,)."""
        points = np.ascontiguousarray(self.space.normalise(self.space.stack(*inputs)))
        lsf, (variance, power) = np.empty((len(points), self.order)), np.empty((2, len(points)))
        filters_into(*self.interpolant, self.kernel_parameters, points, lsf, variance, power)
        return lsf, variance, power

    def spectrum(self, *inputs: npt.ArrayLike, frequencies_hz: FloatArray) -> FloatArray:
        """Return the one-sided power spectral density in (m/s2)^2/Hz, shape (k, f) or (f,).

        Parameters
        ----------
        *inputs
            As for `at`; if all are scalars the result has the shape of the frequencies.
        frequencies_hz
            Shape (f,), from 0 to half the sampling rate.

        Raises
        ------
        InputError
            There are not d inputs.
        """
        from mmt.texture.autoregression.forms import lsf_spectrum

        lsf, variance = self.at(*inputs)
        density = lsf_spectrum(lsf, variance, frequencies_hz, self.rate_hz)
        return density if any(np.ndim(each) for each in inputs) else density[0]

    def save(self, path: str | Path) -> None:
        """Write the model as ``.npz``; the layout is in ``docs/reference/model-file.md``.

        An existing file is replaced once the new one is complete.

        Raises
        ------
        InputError
            The folder does not exist or may not be written to.
        MmtError
            Writing failed, for instance because the disk is full.
        """
        with replacing(Path(path)) as part:
            part.write_bytes(self.to_bytes())

    def to_bytes(self) -> bytes:
        """Return the bytes that `save` writes."""
        return pack_arrays(arrays_of(self.contents))

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the file's contents, and what rendering needs if it is already computed."""
        made = {name: self.__dict__[name] for name in _PREPARED if name in self.__dict__}
        return _restored, (self.contents, made)

    @property
    def contents(self) -> ModelContents:
        """Contents of the model's file."""
        return ModelContents(self.samples, self.method, self.rate_hz, self.field, self.touch_down)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Load a model from a file of this or an earlier version.

        Raises
        ------
        InputError
            The file is missing, is no model, has an unknown version, or holds bad numbers.
        """
        with naming(f"model {path}"):
            return cls.from_bytes(Path(path).read_bytes())

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """Rebuild a model from `to_bytes`; raises `InputError` as `load` does."""
        return cls.from_contents(unpack(data))

    @classmethod
    def from_contents(cls, contents: ModelContents) -> Self:
        """Rebuild a model from `contents`; raises `InputError` as the constructor does."""
        return cls(**contents._asdict())


def _restored(contents: ModelContents, made: dict[str, Any]) -> TextureModel:
    model = TextureModel(**contents._asdict(), at_once=False)
    model.__dict__ |= made
    return model


def load_model(source: str | Path) -> TextureModel:
    """Load a texture model: a shipped one by its name, or a ``.npz`` file.

    Raises
    ------
    InputError
        The source is neither, or no texture model; the message lists the shipped names.

    Examples
    --------
    >>> import mmt
    >>> import numpy as np
    >>> model = mmt.load_model("oak")
    >>> vibration_m_s2 = mmt.Synthesizer(model, seed=1).render(np.full(500, 100.0), np.ones(500))
    >>> vibration_m_s2.shape
    (500,)
    """
    from mmt.models import find_model

    return TextureModel.load(find_model(Path(source)))
