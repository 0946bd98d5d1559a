"""Amplitude spectra of signals, Welch's or raw ones, and their expectation for a known density.

For offline use.
"""

from enum import StrEnum

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError


class Spectra(StrEnum):
    """How an amplitude spectrum is made: Welch's estimate, or raw Fourier amplitudes."""

    WELCH = "welch"
    FOURIER = "fourier"


def amplitude_spectra(
    x: FloatArray, rate_hz: float, nperseg: int | None = 64
) -> tuple[FloatArray, FloatArray]:
    """Return Welch's amplitude spectrum: the square root of the averaged one-sided density.

    Periodic Hann windows of `nperseg` samples, overlapping by half, from the first sample on;
    the mean is not removed; samples after the last whole window are not used. Densities are
    doubled but at 0 and at half the rate.

    Parameters
    ----------
    x : (n,) or (k, n)
        A signal, or one in each row, n at least `nperseg`.
    rate_hz
        Samples a second.
    nperseg
        Window length, at least 2. None gives the raw Fourier amplitudes of the whole signal,
        without a window, on the same scale.

    Returns
    -------
    frequencies_hz : (nperseg // 2 + 1,)
    amplitudes : (nperseg // 2 + 1,) or (k, nperseg // 2 + 1)
        In the signal's unit per square root of Hz.

    Raises
    ------
    InputError
        A signal is too short or not finite, or `nperseg` is below 2.
    """
    signals = np.asarray(x, dtype=np.float64)
    raw = nperseg is None
    nperseg = signals.shape[-1] if nperseg is None else nperseg
    if nperseg < 2 or signals.ndim not in {1, 2} or signals.shape[-1] < nperseg:
        raise InputError(
            f"signals of shape {signals.shape} with windows of {nperseg}: windows of at least 2"
            " samples and signals of at least one window are needed"
        )
    if not np.isfinite(signals).all():
        raise InputError("a signal has a sample that is not finite")
    signals, exponents = scaled_rows(signals)
    window = np.ones(nperseg) if raw else np.hanning(nperseg + 1)[:-1]
    step = nperseg - nperseg // 2  # scipy.signal.welch would cost 42 MB and 0.4 s
    windows = sliding_window_view(signals, nperseg, axis=-1)[..., ::step, :] * window
    density = np.square(np.abs(np.fft.rfft(windows))).mean(axis=-2)
    density *= 2.0 / (rate_hz * np.square(window).sum())
    density[..., :: nperseg // 2 if nperseg % 2 == 0 else nperseg] *= 0.5
    amplitudes: FloatArray = np.ldexp(np.sqrt(density), exponents)
    return np.asarray(np.fft.rfftfreq(nperseg, 1.0 / rate_hz)), amplitudes


def expected_amplitude(density: FloatArray, nperseg: int = 64) -> FloatArray:
    """Return the expected `amplitude_spectra` of a process of known density.

    The expected estimate is the true density seen through the window: its autocorrelation
    times that of the window, transformed back. It puts a known density at the resolution at
    which measured spectra are compared, without the scatter of a realisation.

    Parameters
    ----------
    density : (k, f)
        One-sided power spectral densities at f equally spaced frequencies from 0 to half
        the rate, both included and doubled as `ar_spectrum` has them; f at least `nperseg`
        and fine enough for their lines.
    nperseg
        Window length, even.

    Returns
    -------
    (k, nperseg // 2 + 1)
        Roots of the expected densities, at the frequencies of `amplitude_spectra`.
    """
    correlation = np.fft.irfft(0.5 * np.asarray(density), axis=1)[:, :nperseg]
    window = np.hanning(nperseg + 1)[:-1]
    weight = np.correlate(window, window, "full")[nperseg - 1 :] / np.sum(window**2)
    lags = np.zeros((len(correlation), 2 * nperseg))
    lags[:, :nperseg] = correlation * weight
    lags[:, nperseg + 1 :] = lags[:, nperseg - 1 : 0 : -1]
    expected = np.fft.rfft(lags, axis=1).real[:, ::2]
    expected[:, 1:-1] *= 2.0
    return np.asarray(np.sqrt(np.maximum(expected, 0.0)))


def scaled_rows(values: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int32]]:
    """Return rows (last axis) scaled by powers of two to about one, and the exponents."""
    exponents = np.frexp(np.abs(values).max(axis=-1, keepdims=True))[1]
    return np.ldexp(values, -exponents), exponents
