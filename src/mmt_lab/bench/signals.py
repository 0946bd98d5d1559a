"""Test signals for fits, both texture-like and stiff, and filters in every form."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.burg import burg
from mmt.texture.autoregression.forms import reflection_to_lsf
from mmt_lab.bench import references

RATE_HZ: Final = 1000.0
_SETTLE: Final = 2000
_LOW: Final = np.array([0.05, 0.07, 0.09, 0.11, 0.13])


@dataclass(frozen=True, eq=False)
class StiffCase:
    """A segment (n,) on which a fit of this order is hard, or has an extreme answer."""

    name: str
    signal: FloatArray
    order: int


def texture(samples: int, seed: int) -> FloatArray:
    """Return vibration like a texture's: two resonances over broad-band noise, (samples,)."""
    generator = np.random.default_rng(seed)
    resonances = resonant(samples, np.array([0.95, 0.9]), 2 * np.pi * np.array([0.08, 0.22]), seed)
    broad: FloatArray = 0.3 * generator.standard_normal(samples)
    return resonances / np.std(resonances) + broad


def resonant(samples: int, radius: FloatArray, angle: FloatArray, seed: int) -> FloatArray:
    """Return white noise filtered by conjugate pole pairs in series, radii and angles (p,)."""
    generator = np.random.default_rng(seed)
    signal = generator.standard_normal(samples + _SETTLE)
    for r, w in zip(radius, angle, strict=True):
        signal = lfilter([1.0], [1.0, -2.0 * r * np.cos(w), r * r], signal)
        signal /= np.std(signal)
    return np.ascontiguousarray(signal[_SETTLE:])


def offset_noise(offset: float) -> FloatArray:
    """Return 400 samples of white noise of variance one plus an offset."""
    return offset + np.random.default_rng(3).standard_normal(400)


def clustered(distance: float) -> FloatArray:
    """Return 400 samples of noise through five low pole pairs, `distance` off the unit circle."""
    return resonant(400, np.full(len(_LOW), 1.0 - distance), _LOW, seed=4)


def _stiff_cases() -> tuple[StiffCase, ...]:
    n = np.arange(400.0)
    white = np.random.default_rng(3).standard_normal(400)
    wide = np.linspace(0.3, 2.8, 5)
    tone = np.sin(0.37 * n)
    beat = np.sin(2 * np.pi * 0.1 * n) + np.sin(2 * np.pi * 0.1001 * n)
    filtered = white.copy()
    for _ in range(4):
        filtered = lfilter([0.05], [1.0, -0.95], filtered)
    return (
        StiffCase("5 pole pairs at 0.9999, clustered", clustered(1e-4), 10),
        StiffCase("5 pole pairs at 0.9999, spread", resonant(400, np.full(5, 0.9999), wide, 5), 10),
        StiffCase("5 pole pairs at 0.999999, clustered", clustered(1e-6), 10),
        StiffCase("low-pass noise", filtered, 30),
        StiffCase("sinusoid", tone, 10),
        StiffCase("two sinusoids 0.1 Hz apart", beat, 10),
        StiffCase("sinusoid in 8 bits", np.round(127 * tone) / 127, 16),
        StiffCase("clipped sinusoid", np.clip(tone, -0.5, 0.5), 16),
        StiffCase("white noise on an offset of 1e6", offset_noise(1e6), 10),
        StiffCase("constant", np.full(400, 0.7), 10),
        StiffCase("zero", np.zeros(400), 10),
        StiffCase("impulse", np.eye(1, 400, 200).ravel(), 10),
        StiffCase("step", (n >= 200).astype(np.float64), 10),
        StiffCase("ramp", n / 400, 10),
        StiffCase("white noise of 1e-300", 1e-300 * white, 10),
        StiffCase("white noise of 1e150", 1e150 * white, 10),
        StiffCase("order + 1 samples", white[:11], 10),
    )


STIFF_CASES: Final = _stiff_cases()


@dataclass(frozen=True, eq=False)
class Filters:
    """The same filters (n, m) in every form; ``lsf`` holds their frequencies with all digits."""

    lsf: Sequence[Sequence[Any]]
    reflection: FloatArray
    ar: FloatArray

    @property
    def rounded_lsf(self) -> FloatArray:
        """The line spectral frequencies as floats (n, m)."""
        return np.array(self.lsf, dtype=np.float64)


def spread_filters(order: int, count: int) -> Filters:
    """Return filters with frequencies unevenly spread over (0, pi), like those of textures.

    The frequencies are exactly floats.
    """
    generator = np.random.default_rng(order)
    places = np.arange(1, order + 1) + generator.uniform(-0.35, 0.35, (count, order))
    lsf = np.pi / (order + 1) * places
    exact_ar = [references.lsf_to_ar(row) for row in lsf]
    reflection = [references.step_down(ar) or [] for ar in exact_ar]
    return Filters(
        lsf=[references.exact(row) for row in lsf],
        reflection=np.array(reflection, dtype=np.float64),
        ar=np.array(exact_ar, dtype=np.float64),
    )


def low_pass_filter(order: int) -> Filters:
    """Return the filter that Burg's method finds in noise low-passed at 50 Hz, at 1 kHz.

    The search for its frequencies starts from mmt's result, but is complete whatever that is.
    """
    noise = np.random.default_rng(1).standard_normal(1000)
    sections = butter(8, 0.1, output="sos")
    reflection = burg(sosfilt(sections, noise)[200:], order).reflection
    ar = references.step_up(references.exact(reflection))
    lsf = references.refine_lsf(ar, reflection_to_lsf(reflection))
    if lsf is None:
        message = "the reference has not found all frequencies"
        raise ArithmeticError(message)
    return Filters([lsf], reflection[np.newaxis], np.array([ar], dtype=np.float64))
