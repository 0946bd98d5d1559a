"""Segments as samples of a model: fitted filters of one common order.

Each is fitted by Burg's method (`mmt.texture.autoregression.burg`). Cost: O(samples x order).

A power's effective sample size (`mmt.texture.autoregression.spectra`) follows from
the same recursion, continued to `RESOLVING_ORDER`: a lower order makes narrow lines too broad and
the effective sample size too large.

By the published method, filters and powers are those of the vibration behind the high-pass of the
modelling, else those before it (`mmt.texture.signals.high_pass`).
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import compress
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression import LARGEST_ORDER
from mmt.texture.autoregression.burg import ReflectionFits, burg_batch
from mmt.texture.autoregression.forms import reflection_to_lsf
from mmt.texture.autoregression.spectra import effective_samples
from mmt.texture.segmentation.segments import Segment
from mmt.texture.settings import Inputs, ModellingSettings
from mmt.texture.signals.high_pass import without_high_pass
from mmt.texture.space import InputSpace, TextureSamples

RESOLVING_ORDER: Final = 24
"""Order that resolves narrow lines, for each sample of a frame; at most `LARGEST_ORDER` in all, and
less if a segment may have fewer than four times as many frames."""


class Fit(NamedTuple):
    """One segment as a sample of the model.

    ``packed`` is its row of a model's samples as bytes, a thousand of which join quickly: speed,
    velocity x and y, force, variance, power, effective sample size of the power, number of measured
    samples, and frequencies. ``number`` is unique among the fits of a modeller.
    """

    segment: Segment
    packed: bytes
    number: int


def fit_segments(
    segments: Sequence[Segment], numbers: Iterator[int], settings: ModellingSettings
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
    segments: tuple[Segment, ...], order: int, resolving: int, rate_hz: float
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
