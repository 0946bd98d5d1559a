"""Waveform that knocks have in common, and its matched filter in every segment.

Mostly the same table is struck, and it answers every knock with about the same waveform. It is
estimated from the segments of suspected outliers. Behind their prediction error filters the texture
is white, so that, given onset and amplitude of the waveform in each segment, least squares leads to
a banded system of normal equations; onset and amplitude follow from the waveform by a matched
filter (Kay, "Fundamentals of statistical signal processing", volume II, 1998, section 4.3). Both
steps alternate. The waveform has a Gaussian prior of unit energy that decays.

Not all suspected segments hold the same waveform. Each is weighted by the share of the energy of
its strongest damped tone (`damped_tones`) that the waveform of the others explains. The search
starts from damped tones; the one that explains the most segments is used.

The known waveform replaces a grid of tones by one matched filter, for all modes of the table at
once. Each suspected segment is tested with the waveform estimated from the others (leave-one-out).
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Self

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg.lapack import dpbsv

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.selection.damped_tones import ComplexArray, modes
from mmt.texture.selection.transients import SHORTEST, Packed, Whitening, prediction_error

LEAST: Final = 8
"""Least number of suspected segments from which a waveform is estimated."""

LENGTH: Final = 128
"""Number of samples of the waveform."""

_EARLY: Final = 20  # samples by which it may begin before the segment
_LATE: Final = 16  # samples that it must have left in it
_WHOLE: Final = 0.2  # and share of its energy
_DECAY: Final = 80.0  # of the prior, in samples
_EVERY: Final = 2  # mode is a beginning
_ROUGH: Final = 0.5  # share of the ring that makes a segment count half, at first
_FINE: Final = 0.6  # and then
_SHARP: Final = 8.0
_PLENTY: Final = 100.0  # times enough: more makes no difference
_LOUD: Final = 2.0  # times the median ring; what is louder counts no more
_QUIET: Final = 1e-6  # of it; the same for what is quieter
_BEST: Final = 4
_ROUNDS: Final = 5
_TINY: Final = float(np.finfo(np.float64).tiny)


class WaveMatch(NamedTuple):
    """Best match of a waveform in n segments: ``energy``, ``onset`` and ``amplitude``, (n,)."""

    energy: FloatArray
    onset: IntArray
    amplitude: FloatArray


class WhitenedSegments(NamedTuple):
    """Prediction errors of n segments, each divided by its expected standard deviation.

    ``square`` (n,) is the energy, ``length`` (n,) the samples, ``back`` (n, k) the error
    filtered in reversed time, from `order` samples before its first, ``spectrum`` that
    of it, ``filters`` (n, order + 1) with the leading 1.
    """

    square: FloatArray
    length: IntArray
    back: FloatArray
    spectrum: ComplexArray
    filters: FloatArray

    @classmethod
    def through(cls, segments: Sequence[FloatArray], whitening: Whitening) -> Self:
        """Whiten segments by the filters of their neighbours; those too short become empty."""
        n, order = whitening.ar.shape
        packed = Packed.of(segments)
        longest = int(np.diff(packed.starts).max(initial=0))
        back = np.zeros((n, longest + order))
        energy, length = np.zeros(n), np.zeros(n, dtype=np.int64)
        filters = np.column_stack([np.ones(n), whitening.ar])
        variance = np.maximum(whitening.variance, _TINY)
        _led_back(packed.samples, packed.starts, filters, variance, back, energy, length)
        spectrum = rfft(back, next_fast_len(back.shape[1] + LENGTH, real=True), axis=1)
        return cls(energy, length, back, spectrum, filters)

    def subset(self, numbers: IntArray) -> Self:
        """Return a subset of the segments by index."""
        return type(self)(
            self.square[numbers],
            self.length[numbers],
            self.back[numbers],
            self.spectrum[numbers],
            self.filters[numbers],
        )

    def find(self, waves: FloatArray) -> WaveMatch:
        """Return the best match of waveforms, (LENGTH,) or (n, LENGTH), in each segment."""
        order = self.filters.shape[1] - 1
        size = next_fast_len(self.back.shape[1] + LENGTH, real=True)
        inner = irfft(self.spectrum * np.conj(rfft(waves, size)), size, axis=1)
        each = np.broadcast_to(waves, (len(self.length), LENGTH))
        filtered = np.zeros((len(each), LENGTH + order))
        for lag in range(order + 1):
            filtered[:, lag : lag + LENGTH] += self.filters[:, lag, None] * each
        grown = np.zeros((len(each), LENGTH + order + 1))
        np.cumsum(filtered**2, axis=1, out=grown[:, 1:])
        result = np.zeros((len(each), 3))
        _loudest(inner, order, grown, self.length, result)
        return WaveMatch(result[:, 0], result[:, 1].astype(np.int64), result[:, 2])


@kernel("void(f8[::1], i8[::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[::1], i8[::1])")
def _led_back(
    samples: FloatArray,
    starts: IntArray,
    filters: FloatArray,
    variance: FloatArray,
    back: FloatArray,
    energy: FloatArray,
    length: IntArray,
) -> None:
    """Write the fields of `WhitenedSegments` for packed segments; zeros for those too short."""
    order = filters.shape[1] - 1
    for row in range(variance.size):
        ar = filters[row, 1:].copy()
        error = prediction_error(samples[starts[row] : starts[row + 1]], ar)
        if error.size < SHORTEST:
            continue
        length[row] = error.size
        for n in range(error.size):
            error[n] /= math.sqrt(variance[row])
            energy[row] += error[n] * error[n]
            for lag in range(order + 1):
                back[row, n + order - lag] += filters[row, lag] * error[n]


@kernel("void(f8[:, ::1], i8, f8[:, ::1], i8[::1], f8[:, ::1])")
def _loudest(
    inner: FloatArray, order: int, grown: FloatArray, length: IntArray, result: FloatArray
) -> None:
    """Write energy, onset and amplitude of the best match of the waveform.

    ``inner`` holds the wave's inner products from onset ``-order`` on, earlier ones at its end;
    ``grown`` the sums of the squares of the filtered wave.
    """
    whole = grown.shape[1] - 1
    for row in range(length.size):
        size = length[row]
        for onset in range(-_EARLY, size - _LATE):
            energy = grown[row, min(whole, size - onset)] - grown[row, max(0, -onset)]
            if energy <= _WHOLE * grown[row, whole]:
                continue
            place = onset + order
            product = inner[row, place if place >= 0 else place + inner.shape[1]]
            explained = product * product / energy
            if explained > result[row, 0]:
                result[row, 0] = explained
                result[row, 1] = onset
                result[row, 2] = product / energy


class _Normal:
    """Normal equations of the waveform, one banded system for each segment."""

    def __init__(self, heard: WhitenedSegments) -> None:
        self._heard = heard
        order = heard.filters.shape[1] - 1
        self._correlation = np.stack(
            [
                (heard.filters[:, lag:] * heard.filters[:, : order + 1 - lag]).sum(axis=1)
                for lag in range(order + 1)
            ]
        )
        falling = np.exp(-2.0 * np.arange(LENGTH) / _DECAY)
        self._prior = falling.sum() / falling

    def solve(self, found: WaveMatch, counts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the waveform (LENGTH,) of all segments, and of all others for each (n, LENGTH)."""
        order = self._heard.filters.shape[1] - 1
        n = len(counts)
        matrices, sides = np.zeros((n, order + 1, LENGTH)), np.zeros((n, LENGTH))
        for index in range(n):
            onset, amplitude = int(found.onset[index]), found.amplitude[index]
            first = max(0, -onset)
            last = min(LENGTH, int(self._heard.length[index]) - onset)
            weight = counts[index] * amplitude
            for lag in range(order + 1):
                matrices[index, lag, first : last - lag] = (
                    weight * amplitude * self._correlation[lag, index]
                )
            back = self._heard.back[index, onset + first + order : onset + last + order]
            sides[index, first:last] = weight * back
        total, left = matrices.sum(axis=0), _of_others(matrices)
        total[0] += self._prior
        left[:, 0] += self._prior
        others = [
            dpbsv(matrix, side, lower=1)[1]
            for matrix, side in zip(left, _of_others(sides), strict=True)
        ]
        return dpbsv(total, sides.sum(axis=0), lower=1)[1], np.array(others)


def _of_others(rows: FloatArray) -> FloatArray:
    """Return leave-one-out sums of rows, without the cancellation of a difference."""
    result = np.zeros_like(rows)
    np.cumsum(rows[:-1], axis=0, out=result[1:])
    result[:-1] += np.cumsum(rows[:0:-1], axis=0)[::-1]
    return result


class KnockWave(NamedTuple):
    """The ``wave`` (LENGTH,), and for each suspected segment that of the ``others``."""

    wave: FloatArray
    others: FloatArray


def learn_wave(
    heard: WhitenedSegments, rings: FloatArray, before: FloatArray | None = None
) -> KnockWave:
    """Return the waveform that suspected segments have in common.

    Parameters
    ----------
    heard
        Suspected segments.
    rings
        Energy of the strongest damped tone in each, shape (n,).
    before
        Waveform to start from instead of damped tones.
    """
    normal = _Normal(heard)
    rings = np.maximum(rings, _TINY / _QUIET)
    if before is None:
        best = _searched(heard, normal, rings)
    else:
        best = KnockWave(before, np.tile(before, (len(rings), 1)))
    weights = np.minimum(1.0, _LOUD * np.median(rings) / rings)
    for _ in range(_ROUNDS if before is None else 1):
        best = _improved(heard, normal, best, rings * _FINE, weights)
    return best


def _searched(heard: WhitenedSegments, normal: _Normal, rings: FloatArray) -> KnockWave:
    """Return the waveform, started from damped tones, that explains the most segments.

    After a first step only the best `_BEST` are refined.
    """
    equal = 1.0 / np.maximum(rings / np.median(rings), _QUIET)
    blows: list[KnockWave] = []
    for mode in modes()[::_EVERY]:
        tone = (mode ** np.arange(LENGTH)).imag
        blow = KnockWave(tone, np.tile(tone, (len(rings), 1)))
        blows.append(_improved(heard, normal, blow, rings * _ROUGH, equal))
    blows.sort(key=lambda blow: -_explained(heard, blow, rings))
    blows = [_improved(heard, normal, blow, rings * _ROUGH, equal) for blow in blows[:_BEST]]
    return max(blows, key=lambda blow: _explained(heard, blow, rings))


def _explained(heard: WhitenedSegments, blow: KnockWave, rings: FloatArray) -> float:
    """Return the number of segments that the waveform of the others explains."""
    return float(_counts(heard.find(_unit(blow.others)).energy, rings * _FINE).sum())


def _improved(
    heard: WhitenedSegments,
    normal: _Normal,
    blow: KnockWave,
    enough: FloatArray,
    weights: FloatArray,
) -> KnockWave:
    found = heard.find(_unit(blow.wave))
    counts = _counts(heard.find(_unit(blow.others)).energy, enough)
    return KnockWave(*normal.solve(found, counts * weights))


def _counts(energy: FloatArray, enough: FloatArray) -> FloatArray:
    """Return the weight of each segment, 0 to 1: one half where the energy equals `enough`."""
    power = (np.minimum(energy, _PLENTY * enough) / enough) ** _SHARP
    return np.asarray(power / (1.0 + power))


def _unit(waves: FloatArray) -> FloatArray:
    norm = np.sqrt((waves**2).sum(axis=-1, keepdims=True))
    return np.asarray(waves / np.maximum(norm, _TINY))


def knock_evidence(heard: WhitenedSegments, accused: BoolArray, blow: KnockWave) -> FloatArray:
    """Return the log ratio of energy explained by the waveform to the rest, shape (n,).

    Zero for segments that are too short.

    Parameters
    ----------
    heard
        All segments.
    accused
        Mask of the segments from which the waveform was estimated, shape (n,).
    blow
        The waveform.
    """
    energy = heard.find(_unit(blow.wave)).energy
    energy[accused] = heard.subset(np.flatnonzero(accused)).find(_unit(blow.others)).energy
    energy = np.maximum(energy, _TINY)
    rest = np.maximum(heard.square - energy, _TINY) / np.maximum(heard.length, 1)
    return np.where(heard.length > 0, np.log(energy / rest), 0.0)
