"""The blow that outliers have in common, and how much of it every segment holds.

What is struck is mostly the same table, and it answers every blow with about the same wave. That
wave is learnt from the segments that were accused: behind their prediction error filters the
texture is white, so that the wave of least squares follows from a banded system of normal
equations, given when and how strongly it is in each; and these follow from the wave by a matched
filter (Kay, "Fundamentals of statistical signal processing", volume II, 1998, section 4.3). Both
are repeated in turn. The wave has a Gaussian prior of unit energy that dies away.

Not all of the accused hold the same wave. A segment counts by how much of the energy of its
loudest ring (`damped_tones`) the wave explains that was learnt from the others.
The search begins with damped tones; what explains the most segments wins.

With the wave known there is one matched filter in the place of a grid of tones, and it is matched
to all of the table's modes at once. Nobody is compared with himself: an accused segment is asked
for the wave of the others.
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
"""So many must be accused before they have something in common."""

LENGTH: Final = 128
"""Samples of the wave."""

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
    """Where a wave is loudest in each of n segments: ``energy``, ``onset`` and ``amplitude``."""

    energy: FloatArray
    onset: IntArray
    amplitude: FloatArray


class WhitenedSegments(NamedTuple):
    """Segments behind their filters, each over its expected deviation.

    ``square`` (n,) is the energy, ``length`` (n,) the samples, ``back`` (n, k) the error led
    through its filter in reversed time, from `order` samples before its first, ``spectrum`` that
    of it, ``filters`` (n, order + 1) with the leading 1.
    """

    square: FloatArray
    length: IntArray
    back: FloatArray
    spectrum: ComplexArray
    filters: FloatArray

    @classmethod
    def through(cls, segments: Sequence[FloatArray], whitening: Whitening) -> Self:
        """Lead segments through the filters of their neighbours; the too short become empty."""
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
        """Return some of the segments."""
        return type(self)(
            self.square[numbers],
            self.length[numbers],
            self.back[numbers],
            self.spectrum[numbers],
            self.filters[numbers],
        )

    def find(self, waves: FloatArray) -> WaveMatch:
        """Return where the waves, of shape (LENGTH,) or one for each segment, are loudest."""
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
    """Write what `WhitenedSegments` holds of packed segments; nothing of one that is too short."""
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
    """Write energy, onset and amplitude where the wave explains most.

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
    """Normal equations of the wave, one banded system for each segment."""

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
        """Return the wave (LENGTH,) of all, and for each segment that of the others."""
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
    """Return the sums without each row: no difference, in which a loud one takes all digits."""
    result = np.zeros_like(rows)
    np.cumsum(rows[:-1], axis=0, out=result[1:])
    result[:-1] += np.cumsum(rows[:0:-1], axis=0)[::-1]
    return result


class KnockWave(NamedTuple):
    """The ``wave`` (LENGTH,) and, for each accused segment, that of the ``others``."""

    wave: FloatArray
    others: FloatArray


def learn_wave(
    heard: WhitenedSegments, rings: FloatArray, before: FloatArray | None = None
) -> KnockWave:
    """Return what accused segments have in common.

    Parameters
    ----------
    heard
        The accused.
    rings
        Energy of the loudest ring of each, shape (n,).
    before
        A wave to begin with in the place of damped tones.
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
    """Return what explains the most segments of what damped tones grow into.

    After a first step `_BEST` of them go on.
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
    """Return how many segments hold a wave that is learnt from the others."""
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
    """Return how far each segment holds the wave, 0 to 1: half where the energy is enough."""
    power = (np.minimum(energy, _PLENTY * enough) / enough) ** _SHARP
    return np.asarray(power / (1.0 + power))


def _unit(waves: FloatArray) -> FloatArray:
    norm = np.sqrt((waves**2).sum(axis=-1, keepdims=True))
    return np.asarray(waves / np.maximum(norm, _TINY))


def knock_evidence(heard: WhitenedSegments, accused: BoolArray, blow: KnockWave) -> FloatArray:
    """Return the logarithm of what the blow explains of each segment over the rest, shape (n,).

    Zero where a segment is too short to tell.

    Parameters
    ----------
    heard
        All segments.
    accused
        Which of them the blow was learnt from, shape (n,).
    blow
        What they have in common.
    """
    energy = heard.find(_unit(blow.wave)).energy
    energy[accused] = heard.subset(np.flatnonzero(accused)).find(_unit(blow.others)).energy
    energy = np.maximum(energy, _TINY)
    rest = np.maximum(heard.square - energy, _TINY) / np.maximum(heard.length, 1)
    return np.where(heard.length > 0, np.log(energy / rest), 0.0)
