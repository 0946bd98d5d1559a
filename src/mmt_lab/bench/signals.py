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
from mmt_lab.stability.families import ar


@dataclass(frozen=True, eq=False)
class StiffCase:
    """A segment (n,) on which a fit of this order is hard, or has an extreme answer."""

    name: str
    signal: FloatArray
    order: int


def texture(samples: int, seed: int) -> FloatArray:
    """Return vibration like a texture's: two resonances over broad-band noise, (samples,)."""
    resonances = ar.poles((0.95, 0.9), (0.503, 1.382), samples=samples, seed=seed)
    broad: FloatArray = 0.3 * np.random.default_rng(seed).standard_normal(samples)
    return resonances / np.std(resonances) + broad


def offset_noise(offset: float) -> FloatArray:
    """Return 400 samples of white noise of variance one plus an offset."""
    return offset + ar.white()


def _stiff_cases() -> tuple[StiffCase, ...]:
    white = filtered = ar.white()
    for _ in range(4):
        filtered = lfilter([0.05], [1.0, -0.95], filtered)
    poles = (
        ("0.9999, clustered", 0.9999, ar.CLUSTERED_RAD),
        ("0.9999, spread", 0.9999, ar.SPREAD_RAD),
        ("0.999999, clustered", 0.999999, ar.CLUSTERED_RAD),
    )
    return (
        *(StiffCase(f"5 pole pairs at {name}", ar.poles(r, w), 10) for name, r, w in poles),
        *(StiffCase(name, signal, 10) for name, signal in ar.signals().items()),
        StiffCase("low-pass noise", filtered, 30),
        StiffCase("ramp", np.arange(400.0) / 400.0, 10),
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
