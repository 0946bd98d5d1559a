"""Filters in every form, each form rounded from many digits."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.signal import butter, sosfilt

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import burg, reflection_to_lsf
from mmt_lab.bench import references

POLE_PAIRS: Final = 8


@dataclass(frozen=True, eq=False)
class Filters:
    """The same filters (n, m) in every form; ``lsf`` holds their frequencies with all digits."""

    lsf: Sequence[Sequence[Any]]
    reflection: FloatArray
    ar: FloatArray

    @property
    def rounded_lsf(self) -> FloatArray:
        """The line spectral frequencies as floats (n, m)."""
        return np.array([references.rounded(row) for row in self.lsf])


def spread(order: int, count: int) -> Filters:
    """Return filters with frequencies unevenly spread over (0, pi), like those of textures."""
    generator = np.random.default_rng(order)
    places = np.arange(1, order + 1) + generator.uniform(-0.35, 0.35, (count, order))
    return _of_frequencies(np.pi / (order + 1) * places)


def low_pass(order: int) -> Filters:
    """Return the filter that Burg's method finds in noise below 50 Hz of 500 Hz."""
    noise = np.random.default_rng(1).standard_normal(1000)
    sections = butter(8, 0.1, output="sos")
    return _of_reflection(burg(sosfilt(sections, noise)[200:], order).reflection)


def pole_pairs(distance: float) -> Filters:
    """Return one filter whose poles are all so far inside the unit circle."""
    angles = np.linspace(0.3, 2.8, POLE_PAIRS) + 0.05 * np.sin(np.arange(POLE_PAIRS) ** 2.0)
    ar = references.poles_to_ar(np.full(POLE_PAIRS, 1.0 - distance), angles)
    return _of_reflection(references.rounded(references.step_down(ar) or []))


def _of_reflection(reflection: FloatArray) -> Filters:
    """Return the one filter whose reflection coefficients are exactly these floats.

    Its frequencies are found from ours, but are complete whatever we found (see there).
    """
    ar = references.step_up(references.exact(reflection))
    lsf = references.refine_lsf(ar, reflection_to_lsf(reflection))
    if lsf is None:
        message = "the reference has not found all frequencies"
        raise ArithmeticError(message)
    return Filters([lsf], reflection[np.newaxis], references.rounded(ar)[np.newaxis])


def _of_frequencies(lsf: FloatArray) -> Filters:
    """Return filters whose line spectral frequencies are exactly these floats."""
    exact_ar = [references.lsf_to_ar(row) for row in lsf]
    reflection = [references.step_down(ar) or [] for ar in exact_ar]
    return Filters(
        lsf=[references.exact(row) for row in lsf],
        reflection=np.array([references.rounded(k) for k in reflection]),
        ar=np.array([references.rounded(ar) for ar in exact_ar]),
    )
