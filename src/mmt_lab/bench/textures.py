"""Known textures: exact filters at any point, and sessions simulated once a run."""

from functools import cache
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.evaluation.grid_errors import GRID_FORCE_N, GRID_SPEED_MM_S
from mmt.evaluation.levels import root_mean_square
from mmt.scene import Scene, SessionTable
from mmt.session.data import RecordedSession
from mmt.testing.simulation.known_surfaces import KnownSurface
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.textures import get_surface
from mmt.texture.autoregression.forms import (
    ar_spectrum,
    lsf_to_ar,
    lsf_to_reflection,
    output_power,
    reflection_to_lsf,
)
from mmt.texture.autoregression.reshaping import levinson
from mmt.texture.model.texture_model import TextureSamples
from mmt.texture.settings import MAXIMUM_FORCE_N, MAXIMUM_SPEED_MM_S
from mmt.texture.signals.metrics import gfc_of_rows, power_error_db
from mmt.texture.space.inputs import ANISOTROPIC, ISOTROPIC

RATE_HZ: Final = 1000.0
SHAPE_HZ: Final[FloatArray] = np.arange(10.0, 501.0, 2.0)
_GRID: Final = 8192
_STROKES_AT_ONCE: Final = 128


@cache
def session(
    surface: str, duration_s: float, seed: int = 1, acceleration_rate_hz: int = 1000
) -> RecordedSession:
    """Return a simulated session on a known texture; the same one within a process."""
    scene = Scene(session=SessionTable(acceleration_rate_hz=acceleration_rate_hz))
    frames, annotations = simulate_session(scene, surface, duration_s, seed)
    return RecordedSession(frames=frames, annotations=annotations)


def exact_samples(
    surface: KnownSurface,
    speed_mm_s: FloatArray,
    force_n: FloatArray,
    order: int,
    heading_rad: FloatArray | None = None,
) -> TextureSamples:
    """Return what an endless recording would be fitted with in strokes (n,).

    The filter of this order whose output has the texture's own first autocorrelations
    (Levinson's recursion), and the texture's exact power. With headings the samples are those
    of an anisotropic model.
    """
    frequencies_hz = np.linspace(0.0, 0.5 * RATE_HZ, _GRID + 1)
    correlation = np.empty((len(speed_mm_s), order + 1))
    for start in range(0, len(speed_mm_s), _STROKES_AT_ONCE):
        part = slice(start, start + _STROKES_AT_ONCE)
        towards = None if heading_rad is None else heading_rad[part]
        density = surface.spectrum(speed_mm_s[part], force_n[part], frequencies_hz, towards)
        lags = np.fft.irfft(0.5 * density, axis=1)[:, : order + 1]
        correlation[part] = lags * RATE_HZ
    reflection = levinson(correlation)
    return TextureSamples(
        inputs=inputs_of(speed_mm_s, force_n, heading_rad),
        lsf=reflection_to_lsf(reflection),
        variance=correlation[:, 0] * np.prod(1.0 - reflection**2, axis=1),
        power=correlation[:, 0],
        space=ISOTROPIC if heading_rad is None else ANISOTROPIC,
    )


def inputs_of(
    speed_mm_s: FloatArray, force_n: FloatArray, heading_rad: FloatArray | None
) -> FloatArray:
    """Return strokes (n,) as inputs of a model, (n, 2), or (n, 3) where there are headings."""
    if heading_rad is None:
        return np.column_stack([speed_mm_s, force_n])
    return np.column_stack(
        [speed_mm_s * np.cos(heading_rad), speed_mm_s * np.sin(heading_rad), force_n]
    )


def scattered(count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return speeds and forces (count,) of points scattered over the plane."""
    points = np.random.default_rng(seed).uniform(0.05, 1.0, (2, count))
    return points[0] * MAXIMUM_SPEED_MM_S, points[1] * MAXIMUM_FORCE_N


class Known:
    """A known texture in strokes at which models are evaluated, each of shape (k,)."""

    def __init__(
        self,
        surface: KnownSurface,
        speed_mm_s: FloatArray,
        force_n: FloatArray,
        heading_rad: FloatArray | None = None,
    ) -> None:
        self.surface = surface
        self.speed_mm_s, self.force_n = speed_mm_s, force_n
        self.inputs = inputs_of(speed_mm_s, force_n, heading_rad)
        density = surface.spectrum(speed_mm_s, force_n, SHAPE_HZ, heading_rad)
        self._amplitude = np.sqrt(density)
        self._power = surface.power(speed_mm_s, force_n, heading_rad)

    def errors(self, lsf: FloatArray, variance: FloatArray) -> tuple[float, float]:
        """Return the errors of filters in the strokes, shapes (k, m) and (k,).

        The first is the mean of one less the goodness of fit between exact amplitude spectra,
        10 to 500 Hz in steps of 2 Hz; the second the root mean square of the power's error, in dB.
        """
        own = np.sqrt(ar_spectrum(lsf_to_ar(lsf), variance, SHAPE_HZ, RATE_HZ))
        power = output_power(variance, lsf_to_reflection(lsf))
        shape = 1.0 - float(gfc_of_rows(own, self._amplitude).mean())
        return shape, root_mean_square(power_error_db(power, self._power))


class Truth(Known):
    """A known texture over the grid of points in the plane at which models are evaluated."""

    def __init__(self, name: str) -> None:
        speed, force = np.meshgrid(GRID_SPEED_MM_S, GRID_FORCE_N)
        super().__init__(get_surface(name), speed.ravel(), force.ravel())
