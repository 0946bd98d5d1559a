"""Measures of the difference between vibrations, and between their spectra.

A score of amplitude spectra means nothing without the way the spectra were made: raw Fourier
amplitudes of two realisations of one process score a GFC of only pi/4 on average. Here an
amplitude spectrum is Welch's (`mmt.texture.signals.amplitude_spectra`) unless raw ones are asked
for, and `gfc_ceiling` gives what a perfect model would score. GFC ignores the level: state
`power_error_db` beside it. For offline use.
"""

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import ar_to_reflection
from mmt.texture.autoregression.simulation import simulate_ar
from mmt.texture.settings import JND_DB
from mmt.texture.signals.amplitude_spectra import amplitude_spectra, scaled_rows


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
    first, second = (scaled_rows(values)[0] for values in _paired("spectra", a, b))
    lengths = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    scores = np.abs(np.sum(first * second, axis=-1)) / np.where(lengths > 0.0, lengths, 1.0)
    alike = first.any(axis=-1) == second.any(axis=-1)
    result: FloatArray = np.where(lengths > 0.0, np.minimum(scores, 1.0), alike)
    return result


def gfc_ceiling(
    ar: FloatArray,
    variance: float,
    samples: int,
    pairs: int,
    generator: np.random.Generator,
    *,
    nperseg: int | None = 64,
) -> float:
    """Return the mean GFC of two realisations of one model, which a perfect model would score.

    Parameters
    ----------
    ar : (m,)
        Filter coefficients without the leading 1.
    variance
        Variance of the excitation; GFC ignores the level, but not its absence.
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
    reflection, level = ar_to_reflection(ar), float(variance > 0.0)
    signals = [simulate_ar(reflection, level, samples, generator) for _ in range(2 * pairs)]
    amplitudes = amplitude_spectra(np.array(signals), 1.0, nperseg)[1]
    return float(np.mean(gfc_of_rows(amplitudes[::2], amplitudes[1::2])))


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
