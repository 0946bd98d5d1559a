"""A texture model against the texture that a simulated session was made from.

Both sides are exact: the texture gives its own spectrum and the model that of its
interpolated filter, so that no score here has the scatter of a realisation. Noise of the sensors
counts as an error of the model. Levels are compared from 8 Hz up: below, the modelling's 10 Hz
high-pass, which keeps the hand's own motion out, leaves too little for a level.
"""

from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.evaluation.model_errors import (
    FELT_HZ,
    LEAST_DENSITY,
    LOWEST_HZ,
    WELCH_S,
    GridErrors,
    HeadingErrors,
    Strokes,
    all_headings,
    band_edges_hz,
    band_membership,
    bounded_error_db,
    by_heading,
    over_plane,
    power_above_felt,
    power_level_error_db,
)
from mmt.evaluation.results import PowerMap, Worst
from mmt.evaluation.worst import StrokeError, explain
from mmt.testing.simulation.surfaces.known_surfaces import KnownSurface
from mmt.testing.simulation.surfaces.textures import surface_from_annotations
from mmt.texture.autoregression.forms import ar_spectra, ar_spectrum, lsf_to_ar
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.metrics import expected_amplitude, gfc_of_rows

_STEP_HZ: Final = 2
_COMPARED: Final = slice(5, None)  # of `_density_hz`: 10 Hz to half the rate
_BINS: Final = slice(1, None)  # of Welch's estimate: 15.6 Hz to half the rate


def _density_hz(rate_hz: float) -> FloatArray:
    """Return the frequencies of spectra at a rate, 2 Hz apart; lines are at least 3 Hz wide."""
    return np.arange(0.0, 0.5 * rate_hz + 1.0, _STEP_HZ)


class _Spectra(NamedTuple):
    """Up to half the rate: densities (k, f), none below `LEAST_DENSITY`, and power.

    ``bands`` (k, b) is their sum by bands, ``amplitude`` (k, w) as by Welch, ``power`` (k,).
    """

    rate_hz: float
    density: FloatArray
    bands: FloatArray
    amplitude: FloatArray
    power: FloatArray


class TruthAt:
    """A known texture at k strokes, at which models are compared with it.

    Parameters
    ----------
    strokes
        The strokes, at least one.
    spectrum
        Returns spectra of the texture there, (k, f), at frequencies (f,).
    rate_hz
        Sampling rate; spectra are compared up to half of it.
    """

    def __init__(
        self, strokes: Strokes, spectrum: Callable[[FloatArray], FloatArray], rate_hz: float
    ) -> None:
        self.strokes = strokes
        self._rate_hz, highest_hz = rate_hz, min(FELT_HZ, 0.5 * rate_hz)
        self._felt = spectrum(np.arange(highest_hz + 1.0))
        self._above = partial(spectrum, _density_hz(rate_hz)[int(highest_hz) // _STEP_HZ + 1 :])
        self.power = np.asarray(np.trapezoid(self._felt[:, LOWEST_HZ:], axis=1))
        """Felt power by the trapezoidal rule in steps of 1 Hz, shape (k,)."""

    @cached_property
    def spectra(self) -> _Spectra:
        """The truth's spectra."""
        density = np.concatenate([self._felt[:, ::_STEP_HZ], self._above()], axis=1)
        return _spectra(self._rate_hz, density, self.power)

    def share_above(self, frequency_hz: float) -> float:
        """Return the share of the power from 10 Hz on that is above a frequency."""
        density = self.spectra.density.sum(axis=0)
        above = _density_hz(self._rate_hz)[_COMPARED] > frequency_hz
        return float(density[above].sum() / density.sum())

    def level_errors_db(self, model: TextureModel) -> FloatArray:
        """Return a model's error of level, (k,), in dB; five to ten times faster than `errors`."""
        lsf, variance, power = model.filters(*self.strokes.inputs(model.space).T)
        own = _felt_power(lsf_to_ar(lsf), variance, power, model.rate_hz)
        return power_level_error_db(own, self.power)

    def errors(self, model: TextureModel) -> GridErrors:
        """Return every error of a model."""
        return _errors(_spectra_of(model, self.strokes), self.spectra)


class KnownTexture:
    """The truth of a simulated session.

    Parameters
    ----------
    surface
        The texture.
    share
        Power of the modelled vibration over that along the normal.

    Attributes
    ----------
    plane
        The truth over the whole plane, and at all headings if the texture depends on them.
    """

    def __init__(self, surface: KnownSurface, share: float = 1.0) -> None:
        self.surface = surface
        self._share = share
        self.plane = self.at(over_plane() if surface.isotropic else all_headings())

    def spectrum(self, strokes: Strokes, frequencies_hz: FloatArray) -> FloatArray:
        """Return the one-sided power spectral density (k, f) that a model should have."""
        return self._share * self.surface.spectrum(
            strokes.speed_mm_s, strokes.force_n, frequencies_hz, strokes.heading_rad
        )

    def at(self, strokes: Strokes) -> TruthAt:
        """Return the truth at strokes, at least one."""
        return TruthAt(strokes, partial(self.spectrum, strokes), self.surface.rate_hz)

    def by_heading(self, models: Mapping[str, GridErrors]) -> tuple[HeadingErrors, ...]:
        """Gather the errors of models over the grid by heading, each under its name.

        The texture's own mean over all headings comes last. Empty if the texture does not
        depend on the heading.
        """
        if self.surface.isotropic:
            return ()
        named = {**models, "mean over headings": self.without_heading()}
        return tuple(by_heading(name, self.plane.strokes, errors) for name, errors in named.items())

    def without_heading(self) -> GridErrors:
        """Return the errors of the texture's own mean over all headings, on the grid.

        A model that does not know the heading cannot be better.
        """
        truth = self.plane.spectra
        count = len(np.unique(self.plane.strokes.heading_rad))
        means = (
            np.repeat(values.reshape(-1, count, *values.shape[1:]).mean(axis=1), count, axis=0)
            for values in (truth.density, truth.bands, np.square(truth.amplitude), truth.power)
        )
        density, bands, square, power = means
        return _errors(_Spectra(truth.rate_hz, density, bands, np.sqrt(square), power), truth)

    def power_map(self, errors: GridErrors) -> PowerMap:
        """Return errors over the grid as a map of the plane.

        If the grid has several headings, the level's error is the root mean square over them,
        and GFC the mean.
        """
        speed_mm_s = np.unique(self.plane.strokes.speed_mm_s)
        force_n = np.unique(self.plane.strokes.force_n)
        shape = len(force_n), len(speed_mm_s), -1
        level_db = errors.power_error_db.reshape(shape)
        return PowerMap(
            speed_mm_s=speed_mm_s,
            force_n=force_n,
            power_error_db=(
                level_db[..., 0]
                if self.surface.isotropic
                else np.sqrt(np.square(level_db).mean(axis=2))
            ),
            gfc=errors.gfc.reshape(shape).mean(axis=2),
        )

    def worst(self, model: TextureModel, errors: GridErrors) -> tuple[Worst, Worst]:
        """Return the worst points in power and in shape, with the causes of the errors there."""
        best = None if self.surface.isotropic else self.without_heading()
        level, form = int(np.abs(errors.power_error_db).argmax()), int(errors.gfc.argmin())

        def own(stroke: Strokes) -> StrokeError:
            return _at(self.at(stroke).errors(model), 0)

        def explained(index: int, *, shape: bool) -> Worst:
            unaware = None if best is None else _at(best, index)
            stroke = self.plane.strokes.at(index)
            return explain(model, stroke, _at(errors, index), own, unaware, shape=shape)

        return explained(level, shape=False), explained(form, shape=True)


def known_texture(
    annotations: bytes, settings: ModellingSettings
) -> tuple[KnownTexture | None, str]:
    """Return the truth that a recording holds, or None, and a sentence on it."""
    if not annotations:
        return None, "the recording names no known texture"
    try:
        surface = surface_from_annotations(annotations)
    except InputError as error:
        return None, str(error)
    if settings.normal != "z" or settings.axis not in {"z", "dft321"}:
        return None, (
            f"the texture {surface.name} is known along the normal z and for dft321; modelled "
            f"is {settings.axis} with the normal {settings.normal}"
        )
    share = 1.0 if settings.axis == "z" else 1.0 + surface.tangential_share**2
    return KnownTexture(surface, share), f"the known texture {surface.name}"


def _spectra_of(model: TextureModel, strokes: Strokes) -> _Spectra:
    lsf, variance, output = model.filters(*strokes.inputs(model.space).T)
    # By the coefficients: several times faster than by LSF.
    ar = lsf_to_ar(lsf)
    density = ar_spectra(ar, variance, round(model.rate_hz / _STEP_HZ), model.rate_hz)
    power = _felt_power(ar, variance, output, model.rate_hz)
    return _spectra(model.rate_hz, density, power)


def _spectra(rate_hz: float, density: FloatArray, power: FloatArray) -> _Spectra:
    amplitude = expected_amplitude(density, round(WELCH_S * rate_hz))[:, _BINS]
    density = np.maximum(density[:, _COMPARED], LEAST_DENSITY)
    member = band_membership(_density_hz(rate_hz)[_COMPARED], band_edges_hz(rate_hz))
    return _Spectra(rate_hz, density, density @ member, amplitude, power)


def _felt_power(
    ar: FloatArray, variance: FloatArray, power: FloatArray, rate_hz: float
) -> FloatArray:
    """Return the part (k,) of the power that is felt, from 8 Hz on, of filters (k, m)."""
    low = ar_spectrum(ar, variance, np.arange(LOWEST_HZ + 1.0), rate_hz)
    lost = np.trapezoid(low, axis=1) + power_above_felt(ar, power, rate_hz)
    return np.asarray(power - np.minimum(lost, 0.999 * power))


def _errors(own: _Spectra, truth: _Spectra) -> GridErrors:
    ratio_db = bounded_error_db(own.density, truth.density)
    return GridErrors(
        gfc=gfc_of_rows(own.amplitude, truth.amplitude),
        power_error_db=power_level_error_db(own.power, truth.power),
        log_spectral_db=np.sqrt(np.mean(np.square(ratio_db), axis=1)),
        bands_db=bounded_error_db(own.bands, truth.bands),
    )


def _at(errors: GridErrors, index: int) -> StrokeError:
    return StrokeError(float(errors.power_error_db[index]), float(errors.gfc[index]))
