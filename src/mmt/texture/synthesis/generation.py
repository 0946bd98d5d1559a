"""Generation of vibration: white noise through a filter that may change at every sample.

A filter is a normalised lattice of unit power (`mmt.texture.autoregression.lsf`) and an
amplitude. It may be replaced between any two samples: the lattice's memory is carried over, and
the output stays bounded whatever filters follow each other. The amplitude falls no faster than by
a time constant of 4 ms, so that a hand that stops causes no click, and ends at exactly zero. The
memory is never near zero, so that no number becomes denormal. Cost: O(order) a sample.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge

from mmt.core.arrays import FloatArray
from mmt.core.bounds import check, real_numbers
from mmt.core.compiled import kernel
from mmt.core.errors import InputError
from mmt.texture.autoregression import LARGEST_ORDER
from mmt.texture.autoregression.lsf import lattice_step, lsf_to_lattice_into
from mmt.texture.model.texture_model import TextureModel

_RELEASE_S: Final = 0.004
_NOISE_BLOCK: Final = 2048
_SILENCE: Final = 1e-9  # m/s2, a millionth of what can be felt
LARGEST_AMPLITUDE: Final = 1e150

ORDER, WANTED, _AMPLITUDE = 0, 1, 2
REFLECTION = 3
COMPLEMENT = REFLECTION + LARGEST_ORDER
PAST = COMPLEMENT + LARGEST_ORDER
STATE_SIZE = PAST + LARGEST_ORDER
"""Indices in a generator's state: order and amplitude of the filter, amplitude of the output,
coefficients of the filter, and its memory."""


@dataclass(frozen=True, eq=False)
class VibrationFilter:
    """A filter of unit power and the amplitude of its output.

    Attributes
    ----------
    reflection, complement
        Sines and cosines of the lattice's stages, shape (order,).
    amplitude_m_s2
        Root mean square of the output.
    rate_hz
        Sampling rate that the filter is valid at.
    """

    reflection: FloatArray
    complement: FloatArray
    amplitude_m_s2: float
    rate_hz: float


def estimate(model: TextureModel, *inputs: float) -> VibrationFilter:
    """Return the filter of a model at one moment's inputs.

    Parameters
    ----------
    model
        Texture model.
    *inputs
        Scalar inputs as in `TextureModel.at`.

    Raises
    ------
    InputError
        There are not as many inputs as the model's space has.
    """
    lsf, variance = model.at(*inputs)
    reflection, complement = np.empty(model.order), np.empty(model.order)
    lsf_to_lattice_into(lsf[0], reflection, complement, np.empty(5 * (model.order // 2 + 2)))
    amplitude = float(np.sqrt(variance[0]))
    if amplitude > 0.0:
        amplitude = min(
            float(np.exp(np.log(amplitude) - np.log(complement).sum())), LARGEST_AMPLITUDE
        )
    return VibrationFilter(reflection, complement, amplitude, model.rate_hz)


class Generator:
    """Generate vibration; the same seed gives the same samples whatever the block size.

    Parameters
    ----------
    seed
        Seed of the excitation.
    rate_hz
        Sampling rate, that of the filters.
    limit_m_s2
        Bound on the output.
    """

    def __init__(self, *, seed: int = 0, rate_hz: float = 1000.0, limit_m_s2: float = 60.0) -> None:
        check("seed", seed, Annotated[int, Ge(0)])
        if not limit_m_s2 > 0.0:
            raise InputError(f"limit_m_s2 is {limit_m_s2}, allowed is a number above 0")
        self.limit_m_s2 = limit_m_s2
        self.set_rate(rate_hz)
        self._random = np.random.default_rng(seed)
        self.state = np.zeros(STATE_SIZE)
        self.state[ORDER] = 1.0
        self.state[COMPLEMENT:PAST] = 1.0
        self.state[PAST:] = self._random.standard_normal(LARGEST_ORDER)
        self._noise = self._random.standard_normal(_NOISE_BLOCK)
        self._used = 0
        self._begun = False

    def set_rate(self, rate_hz: float) -> None:
        """Set the sampling rate of the samples that follow."""
        self.rate_hz = rate_hz
        self.release = math.exp(-1.0 / (_RELEASE_S * rate_hz))
        """Least ratio of the amplitudes of successive samples."""

    def set_filter(self, wanted: VibrationFilter | None) -> None:
        """Set the filter; None keeps the last one and lets its amplitude decay."""
        if wanted is None:
            self.state[WANTED] = 0.0
            return
        order = len(wanted.reflection)
        self.state[ORDER] = order
        self.state[REFLECTION : REFLECTION + order] = wanted.reflection
        self.state[COMPLEMENT : COMPLEMENT + order] = wanted.complement
        self.state[WANTED] = wanted.amplitude_m_s2

    def generate(self, count: int) -> FloatArray:
        """Return the next samples in m/s2, shape (count,)."""
        output = np.empty(count)
        generate_into(self.draw(count), self.state, self.release, self.limit_m_s2, output)
        return output

    def reset(self) -> None:
        """Silence the output at once; the excitation goes on."""
        self.state[_AMPLITUDE] = 0.0

    def excitation(self, count: int, given: FloatArray | None) -> FloatArray:
        """Return samples of variance one (count,): the given ones, or else the next drawn.

        If the first samples of all are given ones, the filter's memory starts at zero.
        """
        if given is None:
            return self.draw(count)
        samples = np.ascontiguousarray(real_numbers("excitation", given))
        if samples.shape != (count,) or not np.isfinite(samples).all():
            raise InputError(
                f"excitation has shape {samples.shape}: ({count},) finite samples of variance one, "
                "one for each of the inputs, are needed"
            )
        if not self._begun:
            self._begun = True
            self.state[PAST:] = 0.0
        return samples

    def draw(self, count: int) -> FloatArray:
        """Return the next `count` numbers of one endless sequence, whatever the block sizes."""
        self._begun = True
        left = len(self._noise) - self._used
        if count > left:
            more = self._random.standard_normal(max(_NOISE_BLOCK, count - left))
            self._noise = np.concatenate([self._noise[self._used :], more])
            self._used = 0
        start = self._used
        self._used += count
        return self._noise[start : self._used]


@kernel("f8(f8[::1], f8, f8, f8)")
def scaled(state: FloatArray, value: float, release: float, limit: float) -> float:
    """Return a sample of unit variance at the wanted amplitude, which falls by `release`."""
    amplitude = state[_AMPLITUDE] * release
    if amplitude < _SILENCE:
        amplitude = 0.0
    amplitude = max(amplitude, state[WANTED])
    state[_AMPLITUDE] = amplitude
    return float(min(max(amplitude * value, -limit), limit))


@kernel("void(f8[::1], f8[::1], f8, f8, f8[::1])")
def generate_into(
    noise: FloatArray, state: FloatArray, release: float, limit: float, output: FloatArray
) -> None:
    """Write one sample (n,) for each of the noise's (n,), with the filter in use."""
    reflection, complement, past = state[REFLECTION:], state[COMPLEMENT:], state[PAST:]
    for index in range(len(output)):
        value = lattice_step(reflection, complement, past, int(state[ORDER]), noise[index])
        output[index] = scaled(state, value, release, limit)
