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
from mmt.texture.interpolation import locate
from mmt.texture.lattice import lattice_step, lsf_to_lattice_into
from mmt.texture.model import LEVELS, TextureModel, interpolate_lsf
from mmt.texture.settings import LARGEST_ORDER

_RELEASE_S: Final = 0.004
_NOISE_BLOCK: Final = 2048
_SILENCE: Final = 1e-9  # m/s2, a millionth of what can be felt
_LARGEST_AMPLITUDE: Final = 1e150

_COUNTER, _TRIANGLE, _ORDER, _WANTED, _AMPLITUDE = 0, 1, 2, 3, 4
_REFLECTION = 5
_COMPLEMENT = _REFLECTION + LARGEST_ORDER
_PAST = _COMPLEMENT + LARGEST_ORDER
_STATE_SIZE = _PAST + LARGEST_ORDER


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
        self._scratch = np.zeros(6 * LARGEST_ORDER)

    def render(self, speed_mm_s: FloatArray, force_n: FloatArray) -> FloatArray:
        """Return the next n samples of vibration in m/s2.

        Parameters
        ----------
        speed_mm_s, force_n
            The hand's speed and normal force at each sample, shape (n,), float64. Clipped to
            the plane; what is negative or not finite counts as zero.
        """
        count = len(speed_mm_s)
        output = np.empty(count)
        noise = self._draw(count)
        model = self.model
        if model is None:
            _fade(noise, self._state, self._release(1000.0), self._limit, output)
            return output
        _render(
            model.vertices,
            model.triangles,
            LEVELS[model.interpolate],
            speed_mm_s,
            force_n,
            1.0 / model.maximum_speed_mm_s,
            1.0 / model.maximum_force_n,
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
    "void(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1], f8, f8, i8, f8, f8, f8[::1], f8[::1],"
    " f8[::1], f8[::1])"
)
def _render(
    vertices: FloatArray,
    triangles: IntArray,
    level_kind: int,
    speed_mm_s: FloatArray,
    force_n: FloatArray,
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
    order = vertices.shape[1] - 3
    weights, lsf, work = scratch[:3], scratch[3 : 3 + order], scratch[3 + LARGEST_ORDER :]
    reflection = state[_REFLECTION : _REFLECTION + order]
    complement = state[_COMPLEMENT : _COMPLEMENT + order]
    past = state[_PAST:]
    for index in range(len(output)):
        if int(state[_COUNTER]) % renewal == 0:
            x = speed_mm_s[index] * per_speed
            y = force_n[index] * per_force
            x = min(x, 1.0) if x > 0.0 else 0.0
            y = min(y, 1.0) if y > 0.0 else 0.0
            triangle = locate(vertices, triangles, int(state[_TRIANGLE]), x, y, weights)
            level = interpolate_lsf(vertices, triangles, triangle, weights, lsf)
            lsf_to_lattice_into(lsf, reflection, complement, work)
            state[_TRIANGLE] = triangle
            state[_ORDER] = order
            state[_WANTED] = _amplitude(level, level_kind, complement)
        state[_COUNTER] += 1.0
        value = lattice_step(reflection, complement, past, int(state[_ORDER]), noise[index])
        output[index] = _scale(state, value, release, limit)
