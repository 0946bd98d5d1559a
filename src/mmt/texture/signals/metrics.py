"""Measures of the difference between vibrations, and between their spectra.

A score of amplitude spectra depends on how the spectra are estimated: raw Fourier amplitudes of
two realisations of one process score a GFC of only pi/4 on average. Here an amplitude spectrum is
Welch's (`mmt.texture.signals.amplitude_spectra`) unless raw ones are asked for, and two renderings
of one model give the score of a perfect model. GFC ignores the level, so state `power_error_db`
beside it. For offline use.
"""

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.settings import JND_DB
from mmt.texture.signals.amplitude_spectra import scaled_rows


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
