"""A known texture that gives way to the samples of the one at hand, as they come.

What the samples say of the known texture is how far they are off: in the logarithm of the
power, and in ``artanh`` of each reflection coefficient, where every number is a stable filter.
Either departure is a Gaussian process over ln(speed) and ln(force), and over the heading where
it counts: a constant, a slope in each, and a smooth part (Rasmussen and Williams, Gaussian
Processes for Machine Learning, 2006, sections 2.2 and 2.7). Its posterior mean is added to the
known texture. Beside a sample that is sure the result is the sample; far from all of them it is
the known texture, moved by what all have in common. A power's noise follows from its effective
sample size (`mmt.texture.autoregression.effective_sample_size`), and so does a coefficient's.

Filters of different orders meet without an error: further reflection coefficients of zero leave
a filter as it is. Cost: O(n^3) for n samples, of which the newest `LARGEST` count.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.effective_sample_size import UNKNOWN, log_power_scatter
from mmt.texture.autoregression.forms import lsf_to_reflection
from mmt.texture.library.conversion import Field, field, grid, model_of
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.samples import TextureSamples
from mmt.texture.model.texture_model import TextureModel

LARGEST: Final = 200
"""So many of the newest samples count."""

_SLOWEST: Final = 0.01
_LENGTHS: Final = (1.0, 1.5)  # nepers of speed and force
_TURN: Final = 0.5  # of the unit circle
_STEEPEST: Final = 6.0


class Departure(NamedTuple):
    """Standard deviations of how far two textures are apart, our choice: constant, slopes, rest."""

    constant: float
    slope: float
    rest: float


LEVEL: Final = Departure(0.7, 0.7, 0.35)
SHAPE: Final = Departure(0.6, 0.25, 0.3)
_EXTRA: Final = 0.05  # standard deviation of what else scatters, in either


def blend(
    known: TextureModel, gain: float, samples: TextureSamples | None, space: InputSpace
) -> TextureModel:
    """Return a model that is a known texture far from samples and the samples where they are.

    Parameters
    ----------
    known
        The known texture, in either space.
    gain
        Factor on its power.
    samples
        Samples of the texture at hand, in `space`; None where there are none yet.
    space
        Input space of the model that is returned.
    """
    inputs = grid(space)
    start = field(known, space, inputs)
    wanted = Field(start.logarithm + np.log(gain), np.arctanh(start.reflection))
    audible = None if samples is None else _newest(samples)
    if audible is not None and len(audible):
        wanted = _moved(known, wanted, audible, inputs, np.log(gain))
    reflection = np.tanh(np.clip(wanted.reflection, -_STEEPEST, _STEEPEST))
    return model_of(Field(wanted.logarithm, reflection), space, inputs, known.rate_hz)


def _newest(samples: TextureSamples) -> TextureSamples:
    kept = np.flatnonzero(samples.power > 0.0)[-LARGEST:]
    effective = np.full(len(samples), UNKNOWN) if samples.effective is None else samples.effective
    return TextureSamples(
        samples.inputs[kept],
        samples.lsf[kept],
        samples.variance[kept],
        samples.power[kept],
        samples.space,
        effective[kept],
    )


def _moved(
    known: TextureModel, at: Field, samples: TextureSamples, inputs: FloatArray, gain_ln: float
) -> Field:
    """Return the field at inputs (k, d), moved by the departure that samples call for."""
    space = samples.space
    assert samples.effective is not None  # noqa: S101 - `_newest` has filled it in
    before = field(known, space, samples.inputs)
    bias, variance = log_power_scatter(samples.effective)
    level = np.log(samples.power) - bias - before.logarithm - gain_ln
    order = max(samples.lsf.shape[1], known.order)
    own, there, here = (
        _padded(values, order)
        for values in (
            np.arctanh(lsf_to_reflection(samples.lsf)),
            np.arctanh(before.reflection),
            at.reflection,
        )
    )
    ours, theirs = _features(space, samples.inputs), _features(space, inputs)
    middle = ours[:, :2].mean(axis=0)  # so that one sample alone says nothing of slopes
    ours[:, :2] -= middle
    theirs[:, :2] -= middle
    by_level = _posterior(LEVEL, ours, theirs, variance + _EXTRA**2, level[:, None])
    by_shape = _posterior(SHAPE, ours, theirs, 1.0 / samples.effective + _EXTRA**2, own - there)
    return Field(at.logarithm + by_level[:, 0], here + by_shape)


def _posterior(
    departure: Departure,
    ours: FloatArray,
    theirs: FloatArray,
    noise: FloatArray,
    values: FloatArray,
) -> FloatArray:
    """Return the mean (k, c) at `theirs` of a process that has values (n, c) at `ours`."""
    own = _covariance(departure, ours, ours)
    own[np.diag_indices_from(own)] += noise
    return np.asarray(_covariance(departure, theirs, ours) @ cho_solve(cho_factor(own), values))


def _covariance(departure: Departure, one: FloatArray, other: FloatArray) -> FloatArray:
    slopes = one[:, :2] @ other[:, :2].T
    scale = np.array([*_LENGTHS, _TURN, _TURN][: one.shape[1]])
    square = np.square((one[:, None, :] - other[None, :, :]) / scale).sum(axis=2)
    smooth = departure.rest**2 * np.exp(-0.5 * square)
    total: FloatArray = departure.constant**2 + departure.slope**2 * slopes + smooth
    return total


def _features(space: InputSpace, inputs: FloatArray) -> FloatArray:
    """Return ln(speed) and ln(force), and the heading's cosine and sine."""
    points = space.normalise(inputs)
    speed = np.hypot(points[:, 0], points[:, 1]) if space.directed else points[:, 0]
    columns = [np.log(np.maximum(value, _SLOWEST)) for value in (speed, points[:, -1])]
    if space.directed:
        columns += [points[:, axis] / np.maximum(speed, _SLOWEST) for axis in (0, 1)]
    return np.stack(columns, axis=1)


def _padded(values: FloatArray, order: int) -> FloatArray:
    return np.pad(values, ((0, 0), (0, order - values.shape[1])))
