"""Evidence of knocks in a segment's own samples: damped tones after the prediction error filter.

A struck object rings in its modes, each a damped sinusoid from the instant of the knock. Against a
texture of known spectrum, the most powerful test for a mode is a matched filter after the texture's
prediction error filter (Kay, "Fundamentals of statistical signal processing", volume II, 1998,
section 7.4): the squared projection of the prediction error on the filtered cosine and sine. Mode
and instant are unknown, so the largest over a grid is taken, a generalised likelihood ratio. The
test also detects tones at frequencies of the texture: after the filter, the click of their onset
remains.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import wrightomega

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.burg import levinson
from mmt.texture.autoregression.forms import reflection_to_ar
from mmt_methods.selection.points import band

ComplexArray = npt.NDArray[np.complex128]

SHORTEST_MS: Final = 64
"""Least length of prediction error in which a tone is looked for."""

LEFT_MS: Final = 8
"""Least part of a mode that must lie in the segment."""

_LEAST: Final = 1e-9  # relative determinant; below, cosine and sine are too alike
_TINY: Final = float(np.finfo(np.float64).tiny)
_LARGEST: Final = 1e100  # times the expected energy; more makes no difference
_LARGEST_SHARE: Final = 1.0 - 1e-9  # cap on the share of the energy that a tone explains


def modes(rate_hz: float) -> ComplexArray:
    """Return a grid of modes from 25 to 330 Hz, as factors from one sample to the next, (k,).

    Each falls to 1/e in 25 ms. Tones twice or half as long are detected nearly as well.
    """
    per_s = -1000.0 / 25.0 + 2j * np.pi * np.geomspace(25.0, 330.0, 24)
    return np.asarray(np.exp(per_s / rate_hz))


class Whitening(NamedTuple):
    """Prediction error filters: ``ar`` (n, m) without the leading 1, ``variance`` (n,)."""

    ar: FloatArray
    variance: FloatArray


def whitening(density: FloatArray, order: int) -> Whitening:
    """Return the prediction error filters of power spectra (n, f) at `band`.

    Levinson's recursion on their autocorrelations, all at once; O(n (f order + order^2)).
    """
    lags = np.cos(2.0 * np.pi * np.outer(band(density.shape[1]), np.arange(order + 1)))
    correlation = density @ lags / density.shape[1]
    scale = correlation[:, :1].copy()
    correlation /= scale
    correlation[:, 0] += 1e-9  # a floor 90 dB down keeps it definite
    reflection = levinson(correlation)
    error = correlation[:, 0] * np.prod(1.0 - np.square(reflection), axis=1)
    return Whitening(reflection_to_ar(reflection), 0.5 * error * scale[:, 0])


def loudest_tone_energy(error: FloatArray, ar: FloatArray, modes: ComplexArray, left: int) -> float:
    """Return the largest energy of a prediction error (n,) that one damped tone explains.

    Parameters
    ----------
    error
        Prediction error, shape (n,).
    ar
        Filter that has produced the error, without the leading 1, shape (m,).
    modes
        See `modes`, shape (k,).
    left
        Least number of samples of a mode in the segment.

    Notes
    -----
    O(n (m + k)): one recursion in reversed time covers all instants of a mode. The recursion is
    stable, since every mode decays.
    """
    whitener = np.append(1.0, ar)
    matched = np.convolve(error[::-1], whitener)[: len(error)]
    return float(_loudest(matched, whitener, modes, left))


@kernel("f8(f8[::1], f8[::1], c16[::1], i8)")
def _loudest(matched: FloatArray, whitener: FloatArray, modes: ComplexArray, least: int) -> float:
    """Return the largest energy from the error, filtered once more in reversed time.

    ``w`` is the next sample of the filtered mode: if the tone begins one sample earlier, one more
    sample lies in the segment.
    """
    loudest = 0.0
    for k in range(modes.size):
        mode = modes[k]
        inner, square, tone, part, delay = 0j, 0j, 1.0 + 0j, 0j, 1.0 + 0j
        power = 0.0
        for left in range(matched.size):
            if left < whitener.size:
                part += whitener[left] * delay
                delay /= mode
            w = tone * part
            tone *= mode
            inner = matched[left] + mode * inner
            power += w.real * w.real + w.imag * w.imag
            square += w * w
            cosine, sine = 0.5 * (power + square.real), 0.5 * (power - square.real)
            cross = 0.5 * square.imag
            determinant = cosine * sine - cross * cross
            if left >= least - 1 and determinant > _LEAST * cosine * sine:
                explained = sine * inner.real * inner.real + cosine * inner.imag * inner.imag
                explained -= 2.0 * cross * inner.real * inner.imag
                loudest = max(loudest, explained / determinant)
    return loudest


def tone_evidence(
    segments: Sequence[FloatArray], filters: Whitening, level_variance: FloatArray, rate_hz: float
) -> FloatArray:
    """Return log likelihood ratios (n,) of the likeliest damped tone against none, in nepers.

    Parameters
    ----------
    segments
        Vibration.
    filters
        Prediction error filters of the predicted spectra.
    level_variance
        Variance of the logarithm of the predicted excitation's variance, positive, shape (n,).
    rate_hz
        Sampling rate.

    Notes
    -----
    The level is unknown within its predicted error, so both likelihoods are those of the likeliest
    level. The maximum over more instants is larger by the logarithm of their number (Gumbel), which
    is subtracted: one instant for each millisecond, within which a mode changes little. Zero if a
    segment is too short to tell.
    """
    found = np.zeros((3, len(segments)))
    order, per_ms, grid = filters.ar.shape[1], rate_hz / 1000.0, modes(rate_hz)
    left = round(LEFT_MS * per_ms)
    for index, (segment, ar, variance) in enumerate(zip(segments, *filters, strict=True)):
        if len(segment) - order < SHORTEST_MS * per_ms:
            continue
        error = np.convolve(segment, np.append(1.0, ar), "valid")
        energy = max(float(error @ error), _TINY)
        share = min(loudest_tone_energy(error, ar, grid, left) / energy, _LARGEST_SHARE)
        found[:, index] = error.size, min(energy / max(variance, _TINY), _LARGEST), share
    count, energies, shares = found
    rest = (1.0 - shares) * energies
    gain = _surprise(energies, count, level_variance) - _surprise(rest, count, level_variance)
    return np.where(count > 0.0, gain - np.log(np.maximum(count / per_ms, 1.0)), 0.0)


def _surprise(energy: FloatArray, count: FloatArray, variance: FloatArray) -> FloatArray:
    """Return minus the log likelihood of white noise at the likeliest level, up to a constant.

    It is the minimum over s, a normal offset of the level, of
    ``count / 2 s + energy / 2 exp(-s) + s^2 / (2 variance)``. The minimum is at
    ``s = omega(ln(variance energy / 2) + variance count / 2) - variance count / 2``, by Wright's
    omega function (Corless and Jeffrey, "The Wright omega function", 2002). There the derivative is
    zero, and ``energy exp(-s)`` is ``count + 2 s / variance``.
    """
    expected = 0.5 * variance * count
    s = wrightomega(np.log(np.maximum(0.5 * variance * energy, _TINY)) + expected) - expected
    return np.asarray(0.5 * (count * (s + 1.0) + s * (s + 2.0) / variance))
