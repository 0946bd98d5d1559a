"""Measures of the difference between vibrations, and between their spectra.

A score of amplitude spectra means nothing without the way the spectra were made: raw Fourier
amplitudes of two realisations of one process score a GFC of only pi/4 on average. Here an
amplitude spectrum is always Welch's (see `amplitude_spectrum`), and `gfc_ceiling` gives what
a perfect model would score. GFC ignores the level: state `power_error_db` beside it. Numpy
alone; offline use.
"""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from mmt.arrays import FloatArray
from mmt.errors import InputError
from mmt.texture.autoregression import ar_to_reflection
from mmt.texture.realisation import realise

JND_DB: Final = 20.0 * math.log10(1.17)
"""Just noticeable difference of vibration, 17 % in amplitude (Awan et al., section VII.A)."""


def amplitude_spectrum(
    x: FloatArray, rate_hz: float, nperseg: int = 64
) -> tuple[FloatArray, FloatArray]:
    """Return Welch's amplitude spectrum: the square root of the averaged one-sided density.

    Periodic Hann windows of `nperseg` samples, overlapping by half, from the first sample on;
    the mean is not removed; samples after the last whole window are not used. Densities are
    doubled but at 0 and at half the rate.

    Parameters
    ----------
    x : (n,)
        The signal, n at least `nperseg`.
    rate_hz
        Samples a second.
    nperseg
        Window length, at least 2.

    Returns
    -------
    frequencies_hz : (nperseg // 2 + 1,)
    amplitude : (nperseg // 2 + 1,)
        In the signal's unit per square root of Hz.

    Raises
    ------
    InputError
        The signal is too short or not finite, or `nperseg` is below 2.
    """
    frequencies_hz, amplitudes = amplitude_spectra(np.asarray(x)[np.newaxis], rate_hz, nperseg)
    return frequencies_hz, amplitudes[0]


def amplitude_spectra(
    x: FloatArray, rate_hz: float, nperseg: int = 64
) -> tuple[FloatArray, FloatArray]:
    """Return the `amplitude_spectrum` of many signals at once.

    Parameters
    ----------
    x : (k, n)
        A signal in each row, n at least `nperseg`.
    rate_hz, nperseg
        As in `amplitude_spectrum`.

    Returns
    -------
    frequencies_hz : (nperseg // 2 + 1,)
    amplitudes : (k, nperseg // 2 + 1)

    Raises
    ------
    InputError
        As `amplitude_spectrum`.
    """
    signals = np.asarray(x, dtype=np.float64)
    if nperseg < 2 or signals.ndim != 2 or signals.shape[-1] < nperseg:
        raise InputError(
            f"signals of shape {signals.shape} with windows of {nperseg}: windows of at least 2"
            " samples and signals of at least one window are needed"
        )
    if not np.isfinite(signals).all():
        raise InputError("a signal has a sample that is not finite")
    signals, exponents = _scaled_rows(signals)
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi / nperseg * np.arange(nperseg))
    pieces = np.lib.stride_tricks.sliding_window_view(signals, nperseg, axis=-1)
    transformed = np.fft.rfft(pieces[:, :: (nperseg + 1) // 2] * window, axis=-1)
    density = np.mean(transformed.real**2 + transformed.imag**2, axis=1)
    density *= 2.0 / (rate_hz * np.sum(window * window))
    density[:, 0] *= 0.5
    if nperseg % 2 == 0:
        density[:, -1] *= 0.5
    frequencies_hz = np.arange(nperseg // 2 + 1, dtype=np.float64) * (rate_hz / nperseg)
    amplitudes: FloatArray = np.ldexp(np.sqrt(density), exponents)
    return frequencies_hz, amplitudes


def expected_amplitude(density: FloatArray, nperseg: int = 64) -> FloatArray:
    """Return what `amplitude_spectrum` would give on average over endless realisations.

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
        Roots of the expected densities, at the frequencies of `amplitude_spectrum`.
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


def gfc(a: FloatArray, b: FloatArray) -> float:
    """Return the goodness-of-fit criterion of two amplitude spectra on one frequency grid.

    ``|sum a b| / sqrt(sum a^2 sum b^2)``, from 0 to 1 (Hernandez-Andres et al. 2001; Awan et
    al., equation 2). Two spectra that are zero everywhere are equal: 1. Of one that is zero
    everywhere, the other has nothing: 0.

    Raises
    ------
    InputError
        The shapes differ, or a value is not finite.
    """
    return float(gfc_of_rows(a, b))


def gfc_of_rows(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the `gfc` of many pairs of amplitude spectra at once.

    Parameters
    ----------
    a, b : (n, f)
        A spectrum in each row.

    Returns
    -------
    (n,)

    Raises
    ------
    InputError
        The shapes differ, or a value is not finite.
    """
    first, second = (_scaled_rows(values)[0] for values in _paired("spectra", a, b))
    lengths = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    scores = np.abs(np.sum(first * second, axis=-1)) / np.where(lengths > 0.0, lengths, 1.0)
    alike = first.any(axis=-1) == second.any(axis=-1)
    result: FloatArray = np.where(lengths > 0.0, np.minimum(scores, 1.0), alike)
    return result


def gfc_of_psd(psd_a: FloatArray, psd_b: FloatArray) -> float:
    """Return the GFC of two power spectral densities, by their amplitudes ``sqrt(psd)``.

    For a model's exact spectrum against a known truth. Zero cases as in `gfc`.

    Raises
    ------
    InputError
        The shapes differ, or a value is negative or not finite.
    """
    first, second = _densities(psd_a, psd_b)
    return gfc(np.sqrt(first), np.sqrt(second))


def gfc_of_signals(x: FloatArray, y: FloatArray, nperseg: int = 64) -> float:
    """Return the GFC of the Welch amplitude spectra of two signals of the same rate.

    Parameters
    ----------
    x, y : (n,), (k,)
        Each at least `nperseg` long.

    Raises
    ------
    InputError
        As `amplitude_spectrum`.
    """
    return gfc(amplitude_spectrum(x, 1.0, nperseg)[1], amplitude_spectrum(y, 1.0, nperseg)[1])


def gfc_ceiling(
    ar: FloatArray,
    variance: float,
    samples: int,
    pairs: int,
    generator: np.random.Generator,
    *,
    nperseg: int = 64,
) -> float:
    """Return the mean GFC of two independent realisations of one model: what a perfect one scores.

    Parameters
    ----------
    ar : (m,)
        Filter coefficients without the leading 1.
    variance
        Of the excitation; GFC ignores the level, but not its absence.
    samples
        Length of each realisation: that of the recorded signal.
    pairs
        Number of pairs, at least 1. The standard error of the mean falls with its root.
    generator
        Source of the excitation.
    nperseg
        See `amplitude_spectrum`.

    Raises
    ------
    InputError
        The filter is not stable, there is no pair, or as `amplitude_spectrum`.
    """
    if pairs < 1:
        raise InputError(f"{pairs} pairs of realisations: at least 1 is needed")
    reflection = ar_to_reflection(ar)
    level = float(variance > 0.0)
    scores = [
        gfc_of_signals(
            realise(reflection, level, samples, generator),
            realise(reflection, level, samples, generator),
            nperseg,
        )
        for _ in range(pairs)
    ]
    return float(np.mean(scores))


def power_error_db(power: float | FloatArray, truth: float | FloatArray) -> FloatArray:
    """Return ``10 log10(power / truth)``, element by element.

    Where both are zero the error is 0; where only `power` is, -inf; where only `truth` is, inf.

    Parameters
    ----------
    power, truth
        Mean squares or variances, not negative, of one shape or broadcasting.

    Raises
    ------
    InputError
        A value is negative or not finite.
    """
    first, second = _densities(*np.broadcast_arrays(power, truth))
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


def log_spectral_distance_db(psd_a: FloatArray, psd_b: FloatArray) -> float:
    """Return the root mean square over frequency of the densities' ratio in dB.

    Gray and Markel, "Distance measures for speech processing", IEEE Trans. ASSP 24 (1976),
    380-391. A frequency at which both densities are zero counts as 0 dB; one at which only
    one is makes the distance infinite.

    Raises
    ------
    InputError
        The shapes differ, they are empty, or a value is negative or not finite.
    """
    first, second = _densities(psd_a, psd_b)
    return float(np.sqrt(np.mean(power_error_db(first, second) ** 2)))


def _paired(name: str, a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if first.shape != second.shape or first.size == 0:
        raise InputError(f"{name} of shapes {first.shape} and {second.shape}: one shape is needed")
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        raise InputError(f"{name} with a value that is not finite")
    return first, second


def _densities(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    first, second = _paired("densities or powers", a, b)
    if (first < 0.0).any() or (second < 0.0).any():
        raise InputError("a density or a power is negative")
    return first, second


def _scaled_rows(values: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int32]]:
    """Return rows (last axis) over powers of two, and these: the largest near one, no overflow."""
    exponents = np.frexp(np.abs(values).max(axis=-1, keepdims=True))[1]
    return np.ldexp(values, -exponents), exponents
