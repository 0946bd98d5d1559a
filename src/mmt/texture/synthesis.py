"""Vibration from a texture model, block by block or sample by sample.

Awan et al., section VI: white Gaussian noise of the interpolated variance drives the filter
at the present speed and force, whose memory is carried over every change of filter. Here the
filter is a normalised lattice of unit power (`mmt.texture.lattice`), and its output is
multiplied by the interpolated amplitude: the same spectrum, but the power is the model's at
every sample, also while speed and force change.

Stability: an interpolated filter is a convex combination of ordered LSF and hence stable, and
the lattice stays bounded for every course of stable filters, also one that changes at every
sample. The amplitude falls no faster than by a time constant of 4 ms, so that nothing clicks
where a hand stops, and ends at exactly zero. The memory is never near zero: nothing becomes
denormal. Cost: O(order^2) for a renewal of the filter, O(order) for a sample.
"""

from typing import Final

import numpy as np

from mmt.arrays import FloatArray, IntArray
from mmt.compiled import kernel
from mmt.errors import InputError
from mmt.texture.inputs import normalise_into
from mmt.texture.interpolators import LARGEST_SCRATCH, evaluate_into
from mmt.texture.lattice import lattice_step, lsf_to_lattice_into
from mmt.texture.model import LEVELS, TextureModel
from mmt.texture.settings import LARGEST_ORDER

_RELEASE_S: Final = 0.004
_NOISE_BLOCK: Final = 2048
_SILENCE: Final = 1e-9  # m/s2, a millionth of what can be felt
_LARGEST_AMPLITUDE: Final = 1e150

_COUNTER, _PLACE, _ORDER, _WANTED, _AMPLITUDE = 0, 1, 2, 3, 4
_REFLECTION = 5
_COMPLEMENT = _REFLECTION + LARGEST_ORDER
_PAST = _COMPLEMENT + LARGEST_ORDER
_STATE_SIZE = _PAST + LARGEST_ORDER

_POINT = LARGEST_SCRATCH  # scratch: that of the interpolator, point, level and LSF, work
_VALUES = _POINT + 3
_WORK = _VALUES + 1 + LARGEST_ORDER


class Synthesizer:
    """Render vibration; the same seed gives the same samples whatever the block size.

    Parameters
    ----------
    model
        What to render, None for silence. Assigning `model` later keeps the filter's memory.
    seed
        Of the excitation.
    renewal_samples
        The filter follows speed and force every so many samples.
    limit_m_s2
        Bound of the output.
    """

    def __init__(
        self,
        model: TextureModel | None = None,
        *,
        seed: int = 0,
        renewal_samples: int = 1,
        limit_m_s2: float = 60.0,
    ) -> None:
        self.model = model
        self._renewal = renewal_samples
        self._limit = limit_m_s2
        self._generator = np.random.default_rng(seed)
        self._state = np.zeros(_STATE_SIZE)
        self._state[_ORDER] = 1.0
        self._state[_COMPLEMENT] = 1.0
        self._state[_PAST:] = self._generator.standard_normal(LARGEST_ORDER)
        self._noise = self._generator.standard_normal(_NOISE_BLOCK)
        self._used = 0
        self._scratch = np.zeros(_WORK + 5 * LARGEST_ORDER)

    def render(self, *inputs: FloatArray) -> FloatArray:
        """Return the next n samples of vibration in m/s2.

        Parameters
        ----------
        *inputs
            What the hand does at each sample, in the model's input space: its speed and
            normal force, or its velocity x, y and normal force; each of shape (n,), float64.
            Brought to the end of the space where beyond; a speed or force that is negative,
            and what is no number, count as zero.

        Raises
        ------
        InputError
            There are not as many inputs as the model's space has.
        """
        count = len(inputs[0])
        output = np.empty(count)
        noise = self._draw(count)
        model = self.model
        if model is None:
            _fade(noise, self._state, self._release(1000.0), self._limit, output)
            return output
        space, by = model.space, model.interpolant
        if len(inputs) != space.dimensions:
            raise InputError(
                f"{len(inputs)} inputs were given: the model takes {', '.join(space.channels)}"
            )
        _render(
            by.kind,
            by.rows,
            by.links,
            by.tail,
            LEVELS[model.interpolate],
            model.order,
            len(inputs),
            inputs[0],
            inputs[1],
            inputs[-1],
            1.0 / space.maximum_speed_mm_s,
            1.0 / space.maximum_force_n,
            self._renewal,
            self._limit,
            self._release(model.rate_hz),
            noise,
            self._state,
            self._scratch,
            output,
        )
        return output

    def reset(self) -> None:
        """Be silent at once; the excitation goes on."""
        self._state[_AMPLITUDE] = 0.0

    @staticmethod
    def _release(rate_hz: float) -> float:
        return float(np.exp(-1.0 / (_RELEASE_S * rate_hz)))

    def _draw(self, count: int) -> FloatArray:
        """Return the next `count` numbers of one endless sequence, whatever the block sizes."""
        left = len(self._noise) - self._used
        if count > left:
            more = self._generator.standard_normal(max(_NOISE_BLOCK, count - left))
            self._noise = np.concatenate([self._noise[self._used :], more])
            self._used = 0
        start = self._used
        self._used += count
        return self._noise[start : self._used]


@kernel("f8(f8, i8, f8[::1])")
def _amplitude(level: float, level_kind: int, complement: FloatArray) -> float:
    """Return the root of the output's power."""
    if level_kind == 2:
        return level
    amplitude = np.sqrt(level)
    if level_kind == 0:
        for cosine in complement:
            amplitude /= cosine
    return float(min(amplitude, _LARGEST_AMPLITUDE))


@kernel("f8(f8[::1], f8, f8, f8)")
def _scale(state: FloatArray, value: float, release: float, limit: float) -> float:
    """Return a sample of unit variance at the wanted amplitude, which falls by `release`."""
    amplitude = state[_AMPLITUDE] * release
    if amplitude < _SILENCE:
        amplitude = 0.0
    amplitude = max(amplitude, state[_WANTED])
    state[_AMPLITUDE] = amplitude
    return float(min(max(amplitude * value, -limit), limit))


@kernel("void(f8[::1], f8[::1], f8, f8, f8[::1])")
def _fade(
    noise: FloatArray, state: FloatArray, release: float, limit: float, output: FloatArray
) -> None:
    """Let the vibration of the last filter fall silent."""
    reflection, complement, past = state[_REFLECTION:], state[_COMPLEMENT:], state[_PAST:]
    state[_WANTED] = 0.0
    for index in range(len(output)):
        value = lattice_step(reflection, complement, past, int(state[_ORDER]), noise[index])
        output[index] = _scale(state, value, release, limit)


@kernel(
    "void(i8, f8[:, ::1], i8[:, ::1], f8[:, ::1], i8, i8, i8, f8[::1], f8[::1], f8[::1], f8, f8,"
    " i8, f8, f8, f8[::1], f8[::1], f8[::1], f8[::1])"
)
def _render(
    kind: int,
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    level_kind: int,
    order: int,
    dimensions: int,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    per_speed: float,
    per_force: float,
    renewal: int,
    limit: float,
    release: float,
    noise: FloatArray,
    state: FloatArray,
    scratch: FloatArray,
    output: FloatArray,
) -> None:
    point = scratch[_POINT : _POINT + dimensions]
    values, work = scratch[_VALUES : _VALUES + 1 + order], scratch[_WORK:]
    lsf = values[1:]
    reflection = state[_REFLECTION : _REFLECTION + order]
    complement = state[_COMPLEMENT : _COMPLEMENT + order]
    past = state[_PAST:]
    for index in range(len(output)):
        if int(state[_COUNTER]) % renewal == 0:
            normalise_into(first[index], second[index], third[index], per_speed, per_force, point)
            place = int(state[_PLACE])
            state[_PLACE] = evaluate_into(kind, rows, links, tail, place, point, values, scratch)
            lsf_to_lattice_into(lsf, reflection, complement, work)
            state[_ORDER] = order
            state[_WANTED] = _amplitude(values[0], level_kind, complement)
        state[_COUNTER] += 1.0
        value = lattice_step(reflection, complement, past, int(state[_ORDER]), noise[index])
        output[index] = _scale(state, value, release, limit)
