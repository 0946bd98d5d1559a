"""A texture model against the texture that a simulated session was made from.

Both sides are exact: the texture gives its own spectrum and the model that of its
interpolated filter, so that no score here carries the scatter of a realisation. What the
sensors add and what the modelling's 10 Hz high-pass takes away count as errors of the model.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from mmt.arrays import FloatArray
from mmt.devices.simulated.surfaces import Surface, surface_from_annotations
from mmt.errors import InputError
from mmt.evaluation.levels import level_error_db
from mmt.evaluation.results import PowerMap, Worst
from mmt.texture.autoregression import ar_spectrum, lsf_to_ar
from mmt.texture.metrics import expected_amplitude, gfc_of_rows
from mmt.texture.model import TextureModel
from mmt.texture.settings import ModellingSettings

GRID_SPEED_MM_S: Final[FloatArray] = np.linspace(40.0, 260.0, 12)
GRID_FORCE_N: Final[FloatArray] = np.linspace(0.4, 2.6, 12)
DENSITY_HZ: Final[FloatArray] = np.arange(501.0)
"""Where spectra are computed; lines are at least 3 Hz wide."""

_FINE: Final = slice(10, None, 2)  # of DENSITY_HZ: 10 to 500 Hz in steps of 2 Hz
_BINS: Final = slice(1, None)  # of Welch's estimate: 15.6 to 500 Hz
_SPARSE: Final = 0.2  # of the normalised plane
_MUCH: Final = 0.5


@dataclass(frozen=True)
class GridErrors:
    """GFC and power error (dB) at points of the plane, each of shape (k,).

    ``gfc`` compares the spectra at the resolution of every measured GFC (Welch, 64 samples),
    ``gfc_fine`` at 2 Hz.
    """

    gfc: FloatArray
    gfc_fine: FloatArray
    power_error_db: FloatArray


class _Truth(NamedTuple):
    fine_amplitude: FloatArray
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
    """

    def __init__(self, surface: Surface, share: float = 1.0) -> None:
        self.surface = surface
        self._share = share
        speed, force = np.meshgrid(GRID_SPEED_MM_S, GRID_FORCE_N)
        self._speed_mm_s, self._force_n = speed.ravel(), force.ravel()
        self._reference = self._truth_at(self._speed_mm_s, self._force_n)

    def spectrum(
        self, speed_mm_s: FloatArray, force_n: FloatArray, frequencies_hz: FloatArray
    ) -> FloatArray:
        """Return the one-sided power spectral density (k, f) that a model should have."""
        return self._share * self.surface.spectrum(speed_mm_s, force_n, frequencies_hz)

    def compare(self, model: TextureModel) -> GridErrors:
        """Compare a model over the grid, 12 x 12 points, forces outermost."""
        return _errors(model, self._speed_mm_s, self._force_n, self._reference)

    def compare_at(
        self, model: TextureModel, speed_mm_s: FloatArray, force_n: FloatArray
    ) -> GridErrors:
        """Compare a model at points (k,) of the plane."""
        return _errors(model, speed_mm_s, force_n, self._truth_at(speed_mm_s, force_n))

    def _truth_at(self, speed_mm_s: FloatArray, force_n: FloatArray) -> "_Truth":
        """Return amplitude spectra (k, f), fine and as by Welch, and powers (k,) of the truth.

        The power is the trapezoidal sum of the spectrum from 0 to 500 Hz in steps of 1 Hz.
        The spectrum being even and periodic, the error falls exponentially with a line's
        width over the step: 2e-4 for the narrowest lines, of 3 Hz.
        """
        density = self.spectrum(speed_mm_s, force_n, DENSITY_HZ)
        power = density.sum(axis=1) - 0.5 * (density[:, 0] + density[:, -1])
        return _Truth(np.sqrt(density[:, _FINE]), expected_amplitude(density)[:, _BINS], power)

    @staticmethod
    def power_map(errors: GridErrors) -> PowerMap:
        """Lay errors over the grid out as a map."""
        shape = len(GRID_FORCE_N), len(GRID_SPEED_MM_S)
        return PowerMap(
            speed_mm_s=GRID_SPEED_MM_S,
            force_n=GRID_FORCE_N,
            power_error_db=errors.power_error_db.reshape(shape),
            gfc=errors.gfc.reshape(shape),
        )

    def worst(self, model: TextureModel, errors: GridErrors) -> tuple[Worst, Worst]:
        """Return where the model errs most in power and in shape, and what limits it there."""
        return (
            self._explain(model, errors, int(np.abs(errors.power_error_db).argmax()), shape=False),
            self._explain(model, errors, int(errors.gfc.argmin()), shape=True),
        )

    def _explain(
        self, model: TextureModel, errors: GridErrors, index: int, *, shape: bool
    ) -> Worst:
        speed_mm_s, force_n = self._speed_mm_s[index], self._force_n[index]
        point = model.space.normalise(np.array([[speed_mm_s, force_n]]))[0]
        distances = np.hypot(*(model.points - point).T)
        nearest = int(distances.argmin())
        boundary = _boundary_share(model, point)
        sample_mm_s, sample_n = model.samples.speed_mm_s[nearest], model.samples.force_n[nearest]
        there = self.compare_at(model, np.array([sample_mm_s]), np.array([sample_n]))
        if shape:
            own = 1.0 - there.gfc[0] >= _MUCH * (1.0 - errors.gfc[index])
            what, value = "shape", f"GFC {there.gfc[0]:.3f}"
        else:
            own = there.power_error_db[0] / errors.power_error_db[index] >= _MUCH
            what, value = "level", f"{there.power_error_db[0]:+.1f} dB"
        place = f"the nearest sample ({sample_mm_s:.0f} mm/s, {sample_n:.2f} N)"
        far = f"{distances[nearest]:.2f} of the plane away"
        if boundary >= _MUCH:
            limit = "beyond the samples"
            reason = f"boundary points weigh {boundary:.0%} here; {place} is {far}"
        elif own:
            limit = "fit"
            reason = f"the model's {what} at {place} itself has {value}"
        elif distances[nearest] > _SPARSE:
            limit = "sparse"
            reason = f"{place} is {far}, and the {what} changes in between"
        else:
            limit = "interpolation"
            reason = f"the {what} changes between samples; {place}, {far}, has {value}"
        return Worst(
            measure="gfc" if shape else "power",
            speed_mm_s=float(speed_mm_s),
            force_n=float(force_n),
            power_error_db=float(errors.power_error_db[index]),
            gfc=float(errors.gfc[index]),
            nearest_sample=float(distances[nearest]),
            boundary_share=boundary,
            limit=limit,  # type: ignore[arg-type]
            reason=reason,
        )


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


def _errors(
    model: TextureModel,
    speed_mm_s: FloatArray,
    force_n: FloatArray,
    truth: "_Truth",
) -> GridErrors:
    lsf, variance = model.at(speed_mm_s, force_n)
    # By the coefficients: several times faster than by LSF.
    density = ar_spectrum(lsf_to_ar(lsf), variance, DENSITY_HZ, model.rate_hz)
    return GridErrors(
        gfc=gfc_of_rows(expected_amplitude(density)[:, _BINS], truth.amplitude),
        gfc_fine=gfc_of_rows(np.sqrt(density[:, _FINE]), truth.fine_amplitude),
        power_error_db=level_error_db(model, speed_mm_s, force_n, truth.power),
    )


def _boundary_share(model: TextureModel, point: FloatArray) -> float:
    corners, weights = model.triangulation.weights(point[None, :])
    places = model.vertices[corners[0], :2]
    on_edge = ((places == 0.0) | (places == 1.0)).any(axis=1)
    return float(weights[0][on_edge].sum())
