"""Which known texture a short first look at a surface is most likely of.

The look is vibration with the motion that made it. Given a model, each sample is normal about
what the filter at its speed and force predicts from the samples before, so that the likelihood
follows from the prediction errors (Box, Jenkins and Reinsel, Time Series Analysis, 4th ed.,
section 7.1; here conditional on the first samples of a stretch). One factor on the power is
free, the gain: a finger, a tool and an accelerometer of their own change the level of a texture
more than its spectrum. It is the median over blocks, so that a knock does not decide it, and
what exceeds it by more than a factor `_BOUND` counts as so much.

Assumptions: the vibration is Gaussian, and stationary over a block of 20 samples. Cost: about a
millisecond for a model and 500 samples.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_ar
from mmt.texture.model.texture_model import TextureModel

BLOCK: Final = 20
"""Samples over which the filter is held."""

_MEDIAN: Final = (1.0 - 2.0 / (9.0 * BLOCK)) ** 3  # of a chi-square number over its mean
_BOUND: Final = 6.0
_LEAST: Final = 1e-12  # (m/s2)^2
_LARGEST_GAIN: Final = 1e4


@dataclass(frozen=True)
class Stretch:
    """Vibration without a gap, shape (n,), and the inputs of each sample, shape (n, d)."""

    inputs: FloatArray
    vibration_m_s2: FloatArray


@dataclass(frozen=True)
class Choice:
    """The likeliest known texture.

    Attributes
    ----------
    name
        Name of the texture.
    gain
        Factor on its power.
    log_likelihood
        A sample's, in nats, on the average.
    lead
        By how much the log-likelihood of all samples exceeds that of the next texture, in
        nats; infinite where there is no other.
    samples
        That were compared.
    """

    name: str
    gain: float
    log_likelihood: float
    lead: float
    samples: int

    @property
    def gain_db(self) -> float:
        """The gain in dB."""
        return float(10.0 * np.log10(self.gain))

    def describe(self) -> str:
        """Return the choice in words."""
        lead = f", {self.lead:.0f} nats ahead of the next" if np.isfinite(self.lead) else ""
        return f"{self.name} at {self.gain_db:+.1f} dB, by {self.samples} samples{lead}"

    def as_dict(self) -> dict[str, Any]:
        """Return the choice for a program; a lead that is infinite is None."""
        return {
            "texture": self.name,
            "gain_db": round(self.gain_db, 2),
            "log_likelihood": round(self.log_likelihood, 4),
            "lead": round(self.lead, 1) if np.isfinite(self.lead) else None,
            "samples": self.samples,
        }


def choose(library: Mapping[str, TextureModel], look: Sequence[Stretch]) -> Choice | None:
    """Return the known texture that fits a look best; None where the look is too short.

    Parameters
    ----------
    library
        Models by name, at least one, all functions of the same inputs.
    look
        Stretches; those of less than two blocks after the first samples say nothing.
    """
    order = max(model.order for model in library.values())
    first = -(-order // BLOCK) * BLOCK
    usable = [stretch for stretch in look if len(stretch.vibration_m_s2) >= first + 2 * BLOCK]
    if not usable:
        return None
    found = []
    for name, model in library.items():
        parts = [_errors(model, stretch, first) for stretch in usable]
        ratio, spread = (np.concatenate(column) for column in zip(*parts, strict=True))
        gain = float(np.clip(np.median(ratio) / _MEDIAN, 1.0 / _LARGEST_GAIN, _LARGEST_GAIN))
        bounded = np.minimum(ratio / gain, _BOUND)
        each = -0.5 * (np.log(2.0 * np.pi * gain) + spread + bounded)
        found.append((float(each.mean()), gain, name, len(each) * BLOCK))
    found.sort(key=lambda one: one[0], reverse=True)
    best, gain, name, samples = found[0]
    lead = samples * (best - found[1][0]) if len(found) > 1 else np.inf
    return Choice(name, gain, best, float(lead), samples)


def _errors(model: TextureModel, stretch: Stretch, first: int) -> tuple[FloatArray, FloatArray]:
    """Return mean square errors over variance, and ln(variance), of each block, shape (b,)."""
    blocks = (len(stretch.vibration_m_s2) - first) // BLOCK
    stop = first + blocks * BLOCK
    inputs = stretch.inputs[first:stop].reshape(blocks, BLOCK, -1).mean(axis=1)
    lsf, variance = model.at(*inputs.T)
    variance = np.maximum(variance, _LEAST)
    past = sliding_window_view(stretch.vibration_m_s2, model.order + 1)
    past = past[first - model.order : stop - model.order].reshape(blocks, BLOCK, -1)
    taps = np.hstack([np.ones((blocks, 1)), lsf_to_ar(lsf)])[:, ::-1]
    error = np.einsum("bnj,bj->bn", past, taps)
    return np.mean(np.square(error), axis=1) / variance, np.log(variance)
