"""Segments as samples of a model: fitted filters of one common order.

Each is fitted by Burg's method (`mmt.texture.autoregression.burg`). Cost: O(samples x order).

A power's effective sample size (`mmt.texture.autoregression.forms`) follows from the same
recursion, continued to `RESOLVING_ORDER`: a lower order makes narrow lines too broad and the
effective sample size too large.

By the published method, filters and powers are those of the vibration behind the high-pass of the
modelling, else those before it.

A Butterworth filter of second order with its corner at 10 Hz leaves ``1 / (1 + (10 / f)^4)`` of
the power at f Hz: 0.94 at 20 Hz, half at 10 Hz, 0.29 at 8 Hz. Spectra that were fitted behind the
filter are divided by this share. Below `LOWEST_HZ` too little of the texture is left beside the
hand's own motion, and the share at `LOWEST_HZ` is used.

The memory of a fitted filter limits its resolution: it is 16 ms or more at 1 kHz, but 6 ms at
10 kHz, too short to show the high-pass. So if a frame has several samples of the vibration, the
lowest frequencies are those of filters that are fitted to the means of the frames.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import cache, lru_cache
from itertools import compress
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression import LARGEST_ORDER, TINY
from mmt.texture.autoregression.burg import (
    ReflectionFits,
    burg_batch,
    period_of,
    reflection_of,
    relative_density,
    shares,
)
from mmt.texture.autoregression.forms import (
    ar_spectrum,
    effective_samples,
    lsf_output_power,
    lsf_to_ar,
    reflection_to_ar,
    reflection_to_lsf,
)
from mmt.texture.settings import Inputs, ModellingSettings
from mmt.texture.signals.biquad import VIBRATION_CUTOFF_HZ
from mmt.texture.space import InputSpace, TextureSamples

if TYPE_CHECKING:
    from mmt.texture.segmentation.segmenter import Segment


LOWEST_HZ: Final = 8.0

_WHOLE_HZ: Final = 100.0
"""From here on the high-pass leaves a power as it is; it takes 1e-4 of it."""

_LOW_HZ: Final = 50.0
"""Below this the means of frames give the spectrum; the high-pass takes 0.2 % of the power."""


def without_high_pass(
    fits: ReflectionFits, means: ReflectionFits | None, order: int, rate_hz: float, frame_hz: float
) -> tuple[FloatArray, FloatArray]:
    """Return the filters of vibration before the high-pass, and its power over that behind it.

    Parameters
    ----------
    fits
        Filters fitted behind the high-pass, k of them.
    means
        Filters fitted to the means of frames, of an order that is high enough to show the
        high-pass; None if a frame has one sample.
    order
        Order of the filters that are returned.
    rate_hz, frame_hz
        Sampling rates of the vibration, and of frames.

    Returns
    -------
    reflection, gain
        Shapes (k, order) and (k,), the gain being 1 or more.
    """
    period = period_of(rate_hz)
    density = relative_density(reflection_to_ar(fits.reflection), period)
    if means is not None:
        low_hz = np.arange(0.0, min(_LOW_HZ, 0.5 * frame_hz), rate_hz / period)
        scale = np.maximum(fits.power, TINY) / (density @ shares(period))
        low = ar_spectrum(reflection_to_ar(means.reflection), means.variance, low_hz, frame_hz)
        density[:, : len(low_hz)] = 0.5 * rate_hz * low / scale[:, None]
    restored, power = reflection_of(density * _given_back(rate_hz), order)
    return restored, 2.0 * power / (density @ shares(period))


def gain_without_high_pass(lsf: FloatArray, rate_hz: float) -> FloatArray:
    """Return the power of vibration before the high-pass over that behind it, (k,).

    Parameters
    ----------
    lsf
        Line spectral frequencies of the vibration before the high-pass, (k, order).
    rate_hz
        Sampling rate.
    """
    step_hz = rate_hz / period_of(rate_hz)
    low_hz = np.arange(0.0, min(_WHOLE_HZ, 0.5 * rate_hz), step_hz)
    taken = 1.0 - 1.0 / _given_back(rate_hz)[: len(low_hz)]
    power = lsf_output_power(np.ones(len(lsf)), lsf)
    density = ar_spectrum(lsf_to_ar(lsf), 1.0, low_hz, rate_hz)
    lost = np.trapezoid(density * taken, dx=step_hz, axis=1) / power
    return np.asarray(1.0 / (1.0 - np.minimum(lost, taken[0])))


@cache
def _given_back(rate_hz: float) -> FloatArray:
    period = period_of(rate_hz)
    frequency_hz = np.arange(period // 2 + 1) * (rate_hz / period)
    return np.asarray(1.0 + (VIBRATION_CUTOFF_HZ / np.maximum(frequency_hz, LOWEST_HZ)) ** 4)


RESOLVING_ORDER: Final = 24
"""Order that resolves narrow lines, for each sample of a frame; at most `LARGEST_ORDER` in all, and
less if a segment may have fewer than four times as many frames."""


class Fit(NamedTuple):
    """One segment as a sample of the model.

    ``packed`` is its row of a model's samples as bytes, a thousand of which join quickly: speed,
    velocity x and y, force, variance, power, effective sample size of the power, number of measured
    samples, and frequencies. ``number`` is unique among the fits of a modeller.
    """

    segment: "Segment"
    packed: bytes
    number: int


def fit_segments(
    segments: Sequence["Segment"], numbers: Iterator[int], settings: ModellingSettings
) -> list[Fit]:
    """Fit segments and number the fits; segments that give no filter are left out."""
    order = settings.filter_order
    usable = tuple(
        each for each in segments if 2 * each.measured_count > len(each.vibration_m_s2) > order
    )
    if not usable:
        return []
    rate_hz, per_frame = settings.vibration_rate_hz, settings.samples_per_frame
    shortest = min(RESOLVING_ORDER, settings.shortest_samples // 4)  # as the shortest one allows
    resolving = min(per_frame * shortest, LARGEST_ORDER)
    counts = [segment.measured_count for segment in usable]
    fits, resolved, effective = _resolved(usable, max(order, resolving), resolving, rate_hz)
    measured = np.array([segment.measured_gain for segment in usable])
    variance, power = fits.variances[:, order] * measured, fits.power * measured
    if settings.method == "published":
        lsf = resolved if order == resolving else _lsf_of(fits, order)
    else:
        means = None
        if per_frame > 1:
            frames = [each.vibration_m_s2.reshape(-1, per_frame).mean(axis=1) for each in usable]
            means = burg_batch(frames, max(order // per_frame, shortest))
        reflection, gain = without_high_pass(fits, means, order, rate_hz, settings.rate_hz)
        lsf, power = reflection_to_lsf(reflection), power * gain
        variance = power * np.prod(1.0 - np.square(reflection), axis=1)
    motion = [(each.speed_mm_s, *each.velocity_mm_s, each.force_n) for each in usable]
    rows = np.column_stack([motion, variance, power, effective, counts, lsf])
    fitted = map(Fit, usable, (row.tobytes() for row in rows), numbers)
    distinct = (np.diff(lsf, prepend=0.0, append=np.pi, axis=1) > 0.0).all(axis=1)
    return list(compress(fitted, distinct & np.isfinite(power)))  # no merged LSF, no overflow


@lru_cache(maxsize=1)  # an evaluation fits the same segments by both methods
def _resolved(
    segments: tuple["Segment", ...], order: int, resolving: int, rate_hz: float
) -> tuple[ReflectionFits, FloatArray, FloatArray]:
    """Return the fits of segments, LSF of the resolving order, and effective sample sizes."""
    fits = burg_batch([segment.vibration_m_s2 for segment in segments], order)
    lsf = _lsf_of(fits, resolving)
    counts = np.array([segment.measured_count for segment in segments])
    return fits, lsf, effective_samples(lsf, counts, rate_hz)


def unpacked(packed: Sequence[bytes], space: InputSpace) -> TextureSamples:
    """Return the samples of a model from the `Fit.packed` of each, at least one."""
    rows = _rows(packed)
    return TextureSamples(
        inputs=rows[:, _INPUTS[space.name]],
        lsf=rows[:, _LSF:],
        variance=rows[:, 4],
        power=rows[:, 5],
        space=space,
        effective=rows[:, 6],
        counts=rows[:, 7],
    )


def points_of(fits: Iterable[Fit], space: InputSpace) -> FloatArray:
    """Return the normalised inputs of fits, at least one, in a model's space; (n, d)."""
    return space.normalise(_rows([fit.packed for fit in fits])[:, _INPUTS[space.name]])


_INPUTS: Final[dict[Inputs, list[int]]] = {"isotropic": [0, 3], "anisotropic": [1, 2, 3]}
_LSF: Final = 8
"""Columns of `Fit.packed`: inputs of either space, and the first of the frequencies."""


def _rows(packed: Sequence[bytes]) -> FloatArray:
    return np.frombuffer(b"".join(packed)).reshape(len(packed), -1)


def _lsf_of(fits: ReflectionFits, order: int) -> FloatArray:
    """Return the frequencies of a lower order, through which the recursion has passed."""
    return reflection_to_lsf(np.ascontiguousarray(fits.reflection[:, :order]))
