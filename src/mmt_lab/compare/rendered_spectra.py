"""Errors of the vibration that a generator renders, against a known texture.

A generator has no spectrum in closed form. At some of the strokes made it renders two runs of
vibration with different seeds, at constant motion, in blocks of 10 ms. Their spectra are estimated
by Welch's method, and compared with the texture's spectrum through the same windows. The two runs
scatter independently: the mean of the product of their errors is the square of the error without
the scatter, and half their difference is the scatter.
"""

from time import perf_counter
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.evaluation.model_errors import (
    LOWEST_HZ,
    Strokes,
    band_errors_db,
    bounded_error_db,
    root_mean_square,
)
from mmt.evaluation.truth import KnownTexture
from mmt.texture.signals.metrics import amplitude_spectra, expected_amplitude, within_jnd
from mmt.texture.space import ANISOTROPIC, ISOTROPIC
from mmt_lab.compare.time_limit import time_limit
from mmt_methods.generators.guarded import GuardedGenerator

RATE_HZ: Final = 1000.0
BLOCK_SAMPLES: Final = 10
RUN_S: Final = 6.0
SETTLING_S: Final = 0.2
"""Beginning of a run, which is not judged."""

RUNS: Final = 2

STROKES: Final = 36
"""Number of strokes of a session that are rendered."""

_FINE_SAMPLES: Final = 500  # windows for 2 Hz
_COARSE_SAMPLES: Final = 64  # windows of every measured GFC
_FROM_LOWEST: Final = slice(LOWEST_HZ // 2, None)  # of 0 to 500 Hz in steps of 2 Hz
_FINE: Final = slice(5, None)  # 10 to 500 Hz
_BINS: Final = slice(1, None)  # of the coarse windows: 15.6 to 500 Hz


class WindowedSpectra(NamedTuple):
    """Welch's densities (..., 251) every 2 Hz, and amplitudes (..., 33) every 15.6 Hz."""

    density: FloatArray
    amplitude: FloatArray

    @property
    def power(self) -> FloatArray:
        """Power from 8 Hz up, except for a constant factor, (...)."""
        heard = self.density[..., _FROM_LOWEST]
        return np.asarray(heard.sum(axis=-1) - 0.5 * (heard[..., 0] + heard[..., -1]))


def render_strokes(
    source: GuardedGenerator, strokes: Strokes, seed: int, run_s: float = RUN_S
) -> tuple[FloatArray, FloatArray]:
    """Return two runs of vibration at each of k strokes, (2, k, n), and each block's time (us)."""
    motion = strokes.inputs(ANISOTROPIC if source.directed else ISOTROPIC).T
    settling = round(SETTLING_S * RATE_HZ / BLOCK_SAMPLES)
    blocks = settling + round(run_s * RATE_HZ / BLOCK_SAMPLES)
    lasts_s = blocks * BLOCK_SAMPLES / RATE_HZ
    late = f"generator {source.name}: slower than real time, {lasts_s:g} s of vibration took longer"
    rendered = np.empty((RUNS, motion.shape[1], blocks, BLOCK_SAMPLES))
    times_us = np.empty((RUNS, motion.shape[1], blocks))
    for index in range(motion.shape[1]):
        inputs = np.repeat(motion[:, index : index + 1], BLOCK_SAMPLES, axis=1)
        for run in range(RUNS):
            with time_limit(lasts_s, late):
                source.reset((seed * motion.shape[1] + index) * RUNS + run)
                for block in range(blocks):
                    started = perf_counter()
                    rendered[run, index, block] = source.render(*inputs)
                    times_us[run, index, block] = 1e6 * (perf_counter() - started)
    return rendered[:, :, settling:].reshape(RUNS, motion.shape[1], -1), times_us


def spectra_of(vibration_m_s2: FloatArray) -> WindowedSpectra:
    """Return the spectra of vibration (2, k, n), n at least 500."""
    runs, strokes, samples = vibration_m_s2.shape
    signals = vibration_m_s2.reshape(-1, samples)
    _, fine = amplitude_spectra(signals, RATE_HZ, _FINE_SAMPLES)
    _, coarse = amplitude_spectra(signals, RATE_HZ, _COARSE_SAMPLES)
    return WindowedSpectra(
        np.square(fine).reshape(runs, strokes, -1), coarse.reshape(runs, strokes, -1)
    )


def expected_spectra(truth: KnownTexture, strokes: Strokes) -> WindowedSpectra:
    """Return a texture's spectra through the same windows, each (k, ...)."""
    density = truth.spectrum(strokes, np.arange(0.5 * RATE_HZ + 1.0))
    return WindowedSpectra(
        np.square(expected_amplitude(density, _FINE_SAMPLES)),
        expected_amplitude(density, _COARSE_SAMPLES),
    )


def rendered_errors(
    rendered: WindowedSpectra, truth: WindowedSpectra
) -> tuple[dict[str, float], float]:
    """Compare two runs at each of k strokes with the texture.

    Return the figures of `mmt_lab.compare.judging.figures_of`, and the scatter of the estimate of a
    level in dB, root mean square over the strokes.
    """
    level_db = bounded_error_db(rendered.power, truth.power)
    reference = np.broadcast_to(truth.density, rendered.density.shape)[..., _FINE]
    own = rendered.density[..., _FINE]
    spectrum_db = _root(np.prod(bounded_error_db(own, reference), axis=0).mean(axis=1))
    frequencies_hz = np.arange(10.0, 0.5 * RATE_HZ + 1.0, 2.0)
    bands_db = [band_errors_db(run, reference[0], frequencies_hz) for run in own]
    bands = np.prod(bands_db, axis=0)
    figures = {
        "within_jnd": within_jnd(bounded_error_db(rendered.power.mean(axis=0), truth.power)),
        "power_error_db": float(_root(np.prod(level_db, axis=0).mean())),
        "gfc": float(_gfc(rendered.amplitude[..., _BINS], truth.amplitude[..., _BINS]).mean()),
        "log_spectral_db": float(spectrum_db.mean()),
        "band_error_db": float(_root(bands.mean())),
    }
    return figures, root_mean_square(0.5 * (level_db[0] - level_db[1]))


def _root(square: FloatArray | np.float64) -> FloatArray:
    """Return the root of mean products; if chance makes one negative, the error is 0."""
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))


def _gfc(amplitude: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the GFC (k,) of two runs (2, k, b), whose scatter does not count as power."""
    both = amplitude.mean(axis=0)
    square = np.sum(amplitude[0] * amplitude[1], axis=1) * np.sum(truth * truth, axis=1)
    scores = np.sum(both * truth, axis=1) / np.sqrt(np.where(square > 0.0, square, 1.0))
    return np.where(square > 0.0, np.minimum(scores, 1.0), 0.0)
