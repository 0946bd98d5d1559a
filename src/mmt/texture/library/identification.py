"""Which known texture a short first look at a surface is most likely of, if any.

The look is vibration with the motion that made it. Given a model, each sample is normal about
what the filter at its speed and force predicts from the samples before, so that the likelihood
follows from the prediction errors (Box, Jenkins and Reinsel, Time Series Analysis, 4th ed.,
section 7.1; here conditional on the first samples of a stretch). One factor on the power is
free, the gain: a finger, a tool and an accelerometer of their own change the level of a texture
more than its spectrum. It is the median over blocks, so that a knock does not decide it, and
what exceeds it by more than a factor `_BOUND` counts as so much.

Against the known textures stands that the surface is none of them: one filter, fitted to the look
itself, with a level that follows the law of `mmt.texture.field.covariance`. Its likelihood is
less by ``(p + 1) / 2 ln(n)`` for p coefficients and a gain that were fitted to n samples (Schwarz,
"Estimating the dimension of a model", Annals of Statistics 6, 1978).

Assumptions: the vibration is Gaussian, and stationary over a block of 20 samples. Cost: about a
millisecond for a model and 500 samples.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.burg import burg_batch
from mmt.texture.autoregression.forms import lsf_to_ar, reflection_to_lsf
from mmt.texture.autoregression.order_selection import choose_order
from mmt.texture.field.covariance import coordinates
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.samples import TextureSamples
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.signals.high_pass import without_high_pass

BLOCK: Final = 20
"""Samples over which the filter is held."""

_MEDIAN: Final = (1.0 - 2.0 / (9.0 * BLOCK)) ** 3  # of a chi-square number over its mean
_BOUND: Final = 6.0
_LEAST: Final = 1e-12  # (m/s2)^2
_LARGEST_GAIN: Final = 1e4
_HIGHEST_ORDER: Final = 20  # of the look's own filter: one block's samples


@dataclass(frozen=True)
class Stretch:
    """Vibration without a gap, shape (n,), and the inputs of each sample, shape (n, d)."""

    inputs: FloatArray
    vibration_m_s2: FloatArray


@dataclass(frozen=True)
class Choice:
    """The likeliest texture.

    Attributes
    ----------
    name
        Name of the known texture; None where the look is likelier of none of them.
    gain
        Factor on its power.
    log_likelihood
        A sample's, in nats, on the average, less what a fit to the look costs.
    lead
        By how much the log-likelihood of all samples exceeds that of the next texture, in
        nats; infinite where there is no other.
    samples
        That were compared.
    """

    name: str | None
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
        what = "no known texture"
        if self.name is not None:
            what = f"{self.name} at {self.gain_db:+.1f} dB"
        return f"{what}, by {self.samples} samples{lead}"

    def as_dict(self) -> dict[str, Any]:
        """Return the choice for a program; a lead that is infinite is None."""
        return {
            "texture": self.name,
            "gain_db": round(self.gain_db, 2),
            "log_likelihood": round(self.log_likelihood, 4),
            "lead": round(self.lead, 1) if np.isfinite(self.lead) else None,
            "samples": self.samples,
        }


def choose(
    library: Mapping[str, TextureModel], look: Sequence[Stretch], space: InputSpace
) -> Choice | None:
    """Return the texture that fits a look best; None where the look is too short.

    Parameters
    ----------
    library
        Models by name, of the same inputs.
    look
        Stretches; those of less than two blocks after the first samples say nothing.
    space
        What their inputs are.
    """
    order = max([_HIGHEST_ORDER, *(model.order for model in library.values())])
    first = -(-order // BLOCK) * BLOCK
    usable = [stretch for stretch in look if len(stretch.vibration_m_s2) >= first + 2 * BLOCK]
    if not usable:
        return None
    found = []
    for name, model in [*library.items(), (None, _one_filter(usable, space))]:
        parts = [_errors(model, stretch, first) for stretch in usable]
        ratio, spread = (np.concatenate(column) for column in zip(*parts, strict=True))
        gain = float(np.clip(np.median(ratio) / _MEDIAN, 1.0 / _LARGEST_GAIN, _LARGEST_GAIN))
        bounded = np.minimum(ratio / gain, _BOUND)
        each = -0.5 * (np.log(2.0 * np.pi * gain) + spread + bounded)
        samples = len(each) * BLOCK
        cost = 0.5 * (model.order + 1) * np.log(samples) if name is None else 0.0
        found.append((float(each.mean() - cost / samples), gain, name))
    found.sort(key=lambda one: one[0], reverse=True)
    best, gain, name = found[0]
    lead = samples * (best - found[1][0]) if library else np.inf
    return Choice(name, gain, best, float(lead), samples)


def fitted(
    look: Sequence[Stretch], space: InputSpace, rate_hz: float | None = None
) -> TextureSamples:
    """Return the filters of stretches, of a common order, as samples of a model.

    Of those with more samples than two blocks, at least one. With a sampling rate they are those
    of the vibration before the modelling's high-pass.
    """
    look = [stretch for stretch in look if len(stretch.vibration_m_s2) > 2 * BLOCK]
    vibration = [stretch.vibration_m_s2 for stretch in look]
    fits = burg_batch(vibration, _HIGHEST_ORDER)
    order = choose_order(vibration, _HIGHEST_ORDER)
    reflection, power = np.ascontiguousarray(fits.reflection[:, :order]), fits.power
    if rate_hz is not None:
        reflection, gain = without_high_pass(fits.reflection, order, rate_hz)
        power = power * gain
    return TextureSamples(
        inputs=np.array([stretch.inputs.mean(axis=0) for stretch in look]),
        lsf=reflection_to_lsf(reflection),
        variance=power * np.prod(1.0 - np.square(reflection), axis=1),
        power=power,
        space=space,
        counts=np.array([float(len(part)) for part in vibration]),
    )


def _one_filter(look: Sequence[Stretch], space: InputSpace) -> TextureModel:
    """Return a model of one filter, fitted to all of a look, whose level follows the law."""
    inputs = np.concatenate([stretch.inputs for stretch in look])
    vibration = np.concatenate([stretch.vibration_m_s2 for stretch in look])
    law = coordinates(space.normalise(inputs)).law
    even = Stretch(inputs, vibration * np.exp(0.5 * (law.mean() - law)))
    return TextureModel(fitted([even], space))


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
