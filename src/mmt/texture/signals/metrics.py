"""Amplitude spectra of vibrations, and measures of the difference between vibrations.

A score of amplitude spectra depends on how the spectra are estimated: raw Fourier amplitudes of
two realisations of one process score a GFC of only pi/4 on average. Here an amplitude spectrum is
Welch's unless raw ones are asked for, and two renderings of one model give the score of a perfect
model. GFC ignores the level, so state `power_error_db` beside it. For offline use.
"""

from enum import StrEnum

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.settings import JND_DB


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


def gfc_of_rows(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the goodness-of-fit criterion of pairs of amplitude spectra on one frequency grid.

    ``|sum a b| / sqrt(sum a^2 sum b^2)``, from 0 to 1 (Hernandez-Andres et al. 2001; Awan et
    al., equation 2). Two spectra that are zero everywhere score 1; if only one of them is zero
    everywhere, the score is 0.

    Parameters
    ----------
    a, b : (f,) or (n, f)
        A spectrum, or one in each row.

    Returns
    -------
    () or (n,)

    Raises
    ------
    InputError
        The shapes differ, or a value is not finite.
    """
    first, second = (scaled_rows(values)[0] for values in _paired("spectra", a, b))
    lengths = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    scores = np.abs(np.sum(first * second, axis=-1)) / np.where(lengths > 0.0, lengths, 1.0)
    alike = first.any(axis=-1) == second.any(axis=-1)
    result: FloatArray = np.where(lengths > 0.0, np.minimum(scores, 1.0), alike)
    return result


def power_error_db(power: float | FloatArray, truth: float | FloatArray) -> FloatArray:
    """Return ``10 log10(power / truth)``, element by element.

    The error is 0 if both are zero, -inf if only `power` is zero, and inf if only `truth` is.

    Parameters
    ----------
    power, truth
        Mean squares or variances, not negative, of one shape or broadcasting.

    Raises
    ------
    InputError
        A value is negative or not finite.
    """
    first, second = _paired("powers", *np.broadcast_arrays(power, truth))
    if (first < 0.0).any() or (second < 0.0).any():
        raise InputError("a power is negative")
    with np.errstate(divide="ignore", invalid="ignore"):
        error = 10.0 * (np.log10(first) - np.log10(second))
    return np.where((first == 0.0) & (second == 0.0), 0.0, error)


def within_jnd(error_db: FloatArray) -> float:
    """Return the share of power errors (any shape) that cannot be felt: at most `JND_DB`.

    Raises
    ------
    InputError
        There is no value.
    """
    errors = np.asarray(error_db, dtype=np.float64)
    if errors.size == 0:
        raise InputError("no power error given: the share within one JND is not defined")
    return float(np.mean(np.abs(errors) <= JND_DB))


def _paired(name: str, a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if first.shape != second.shape or first.size == 0:
        raise InputError(f"{name} of shapes {first.shape} and {second.shape}: one shape is needed")
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        raise InputError(f"{name} with a value that is not finite")
    return first, second
