"""A texture model against the texture that a simulated session was made from.

Both sides are exact: the texture gives its own spectrum and the model that of its
interpolated filter, so that no score here carries the scatter of a realisation. What the
sensors add counts as an error of the model. Levels are compared from 8 Hz up: below, the
modelling's 10 Hz high-pass, which keeps the hand's own motion out, leaves too little to tell a
level by.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.evaluation.grid_errors import (
    GridErrors,
    HeadingErrors,
    Strokes,
    all_headings,
    by_heading,
    over_plane,
)
from mmt.evaluation.levels import band_errors_db, bounded_error_db
from mmt.evaluation.results import PowerMap, Worst
from mmt.evaluation.worst import Error, explain
from mmt.testing.simulation.known_surfaces import KnownSurface, surface_from_annotations
from mmt.texture.autoregression.forms import ar_spectrum, lsf_to_ar, lsf_to_reflection, output_power
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.amplitude_spectra import expected_amplitude
from mmt.texture.signals.metrics import gfc_of_rows

DENSITY_HZ: Final[FloatArray] = np.arange(501.0)
"""Where spectra are computed; lines are at least 3 Hz wide."""

LOWEST_HZ: Final = 8
"""Where the level begins; the high-pass leaves 0.29 of a power there."""

_FINE: Final = slice(10, None, 2)  # of DENSITY_HZ: 10 to 500 Hz in steps of 2 Hz
_BINS: Final = slice(1, None)  # of Welch's estimate: 15.6 to 500 Hz


class _Spectra(NamedTuple):
    """Densities (k, f), fine, amplitudes (k, b) as by Welch, and powers (k,)."""

    fine: FloatArray
    amplitude: FloatArray
    power: FloatArray


class KnownTexture:
    """The truth of a simulated session.

    Parameters
    ----------
    surface
        The texture.
    share
        Power of the vibration that the modelling sees over that along the normal.

    Attributes
    ----------
    strokes
        The grid at which models are compared: over the plane, and at all headings where the
        texture depends on them.
    """

    def __init__(self, surface: KnownSurface, share: float = 1.0) -> None:
        self.surface = surface
        self._share = share
        self.strokes = over_plane() if surface.isotropic else all_headings()
        self._reference = self._truth_at(self.strokes)

    def spectrum(self, strokes: Strokes, frequencies_hz: FloatArray) -> FloatArray:
        """Return the one-sided power spectral density (k, f) that a model should have."""
        return self._share * self.surface.spectrum(
            strokes.speed_mm_s, strokes.force_n, frequencies_hz, strokes.heading_rad
        )

    def compare(self, model: TextureModel) -> GridErrors:
        """Compare a model over the grid."""
        return _errors(_spectra_of(model, self.strokes), self._reference)

    def compare_at(self, model: TextureModel, strokes: Strokes) -> GridErrors:
        """Compare a model at other strokes."""
        return _errors(_spectra_of(model, strokes), self._truth_at(strokes))

    def by_heading(self, models: Mapping[str, GridErrors]) -> tuple[HeadingErrors, ...]:
        """Gather the errors of models over the grid by heading, each under its name.

        The texture's own mean over all headings comes last. Empty where the texture does
        not depend on the heading.
        """
        if self.surface.isotropic:
            return ()
        named = {**models, "mean over headings": self.without_heading()}
        return tuple(by_heading(name, self.strokes, errors) for name, errors in named.items())

    def without_heading(self) -> GridErrors:
        """Return the errors of the texture's own mean over all headings, on the grid.

        So far a model that does not know the heading gets at best.
        """
        count = len(np.unique(self.strokes.heading_rad))
        means = (
            np.repeat(values.reshape(-1, count, *values.shape[1:]).mean(axis=1), count, axis=0)
            for values in (
                self._reference.fine,
                np.square(self._reference.amplitude),
                self._reference.power,
            )
        )
        fine, density, power = means
        return _errors(_Spectra(fine, np.sqrt(density), power), self._reference)

    def power_map(self, errors: GridErrors) -> PowerMap:
        """Lay errors over the grid out as a map of the plane.

        Where a grid has several headings, the level's error is its root mean square over
        them, and GFC the mean.
        """
        speed_mm_s = np.unique(self.strokes.speed_mm_s)
        force_n = np.unique(self.strokes.force_n)
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
        """Return where the model errs most in power and in shape, and what limits it there."""
        best = None if self.surface.isotropic else self.without_heading()
        level = int(np.abs(errors.power_error_db).argmax())
        shape = int(errors.gfc.argmin())
        return (
            self._explain(model, errors, best, level, shape=False),
            self._explain(model, errors, best, shape, shape=True),
        )

    def _explain(
        self,
        model: TextureModel,
        errors: GridErrors,
        best: GridErrors | None,
        index: int,
        *,
        shape: bool,
    ) -> Worst:
        def own(stroke: Strokes) -> Error:
            return _at(self.compare_at(model, stroke), 0)

        return explain(
            model,
            self.strokes.at(index),
            _at(errors, index),
            own,
            _at(best, index) if best is not None else None,
            shape=shape,
        )

    def _truth_at(self, strokes: Strokes) -> _Spectra:
        """Return the spectra and powers of the truth.

        The power is the trapezoidal sum of the spectrum from 8 to 500 Hz in steps of 1 Hz.
        """
        density = self.spectrum(strokes, DENSITY_HZ)
        power = _sum(density) - _sum(density[:, : LOWEST_HZ + 1])
        return _Spectra(density[:, _FINE], expected_amplitude(density)[:, _BINS], power)


def known_texture(
    annotations: bytes, settings: ModellingSettings
) -> tuple[KnownTexture | None, str]:
    """Return the truth that a recording carries, None without one, and a sentence on it."""
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
    lsf, variance = model.at(*strokes.inputs(model.space).T)
    # By the coefficients: several times faster than by LSF.
    density = ar_spectrum(lsf_to_ar(lsf), variance, DENSITY_HZ, model.rate_hz)
    power = output_power(variance, lsf_to_reflection(lsf))  # however narrow its lines are
    power = power - np.minimum(_sum(density[:, : LOWEST_HZ + 1]), 0.999 * power)
    return _Spectra(density[:, _FINE], expected_amplitude(density)[:, _BINS], power)


def _sum(density: FloatArray) -> FloatArray:
    """Return the trapezoidal sum of densities (k, f) at every Hz, (k,)."""
    return np.asarray(density.sum(axis=1) - 0.5 * (density[:, 0] + density[:, -1]))


def _errors(own: _Spectra, truth: _Spectra) -> GridErrors:
    ratio_db = bounded_error_db(own.fine, truth.fine)
    return GridErrors(
        gfc=gfc_of_rows(own.amplitude, truth.amplitude),
        gfc_fine=gfc_of_rows(np.sqrt(own.fine), np.sqrt(truth.fine)),
        power_error_db=bounded_error_db(own.power, truth.power),
        log_spectral_db=np.sqrt(np.mean(np.square(ratio_db), axis=1)),
        bands_db=band_errors_db(own.fine, truth.fine, DENSITY_HZ[_FINE]),
    )


def _at(errors: GridErrors, index: int) -> Error:
    return Error(float(errors.power_error_db[index]), float(errors.gfc[index]))
