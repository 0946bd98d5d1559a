"""Vibration from a texture model, block by block or sample by sample.

Awan et al., section VI: the filter at the present speed and force is driven by white Gaussian
noise of the interpolated variance; its past outputs are carried over every change of filter.

Stability: an interpolated filter is a convex combination of ordered LSF and hence stable; a
switch between stable filters can still ring, so the output, and with it the filter's memory,
is clipped at a limit. Where the level is zero (no speed or no force) the memory fades with a
time constant of 4 ms and ends at exactly zero, so that no vibration outlives a stroke. Cost:
O(order^2) for a renewal of the filter, O(order) for a sample.
"""

from typing import Final

import numpy as np

from mmt.arrays import FloatArray, IntArray
from mmt.compiled import kernel
from mmt.texture.interpolation import locate
from mmt.texture.model import LEVELS, TextureModel, interpolate_filter
from mmt.texture.settings import LARGEST_ORDER

_RELEASE_S: Final = 0.004
_NOISE_BLOCK: Final = 2048
_SILENCE: Final = 1e-9  # m/s2, a millionth of what can be felt: flushed before denormals

_COUNTER, _TRIANGLE, _DEVIATION, _ORDER, _NEWEST = 0, 1, 2, 3, 4
_FILTER = 5
_PAST = _FILTER + LARGEST_ORDER
_STATE_SIZE = _PAST + 2 * LARGEST_ORDER


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
        self._noise = self._generator.standard_normal(_NOISE_BLOCK)
        self._used = 0
        self._state = np.zeros(_STATE_SIZE)
        self._scratch = np.zeros(6 * LARGEST_ORDER + 3)

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
            _fade(self._state, self._release(1000.0), output)
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
        """Forget past outputs; the excitation goes on."""
        self._state[:] = 0.0

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


@kernel("f8(f8[::1], f8, f8, f8)")
def _step(state: FloatArray, excitation: float, contraction: float, limit: float) -> float:
    """Filter one sample; a contraction below one moves every pole inward by that factor.

    Past outputs stand twice in a ring of twice the largest order, so that the newest ones
    are always contiguous and nothing is shifted.
    """
    newest = _PAST + int(state[_NEWEST])
    value = excitation
    factor = 1.0
    for index in range(int(state[_ORDER])):
        factor *= contraction
        value -= factor * state[_FILTER + index] * state[newest + index]
    if value > limit:
        value = limit
    elif value < -limit:
        value = -limit
    elif abs(value) < _SILENCE:
        value = 0.0
    place = int(state[_NEWEST]) - 1
    if place < 0:
        place = LARGEST_ORDER - 1
    state[_NEWEST] = place
    state[_PAST + place] = value
    state[_PAST + place + LARGEST_ORDER] = value
    state[_COUNTER] += 1.0
    return value


@kernel("void(f8[::1], f8, f8[::1])")
def _fade(state: FloatArray, contraction: float, output: FloatArray) -> None:
    for index in range(output.shape[0]):
        output[index] = _step(state, 0.0, contraction, np.inf)


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
    weights = scratch[:3]
    lsf = scratch[3 : 3 + LARGEST_ORDER]
    work = scratch[3 + LARGEST_ORDER :]
    ar = state[_FILTER : _FILTER + LARGEST_ORDER]
    for index in range(output.shape[0]):
        if int(state[_COUNTER]) % renewal == 0:
            x = speed_mm_s[index] * per_speed
            y = force_n[index] * per_force
            x = min(x, 1.0) if x > 0.0 else 0.0
            y = min(y, 1.0) if y > 0.0 else 0.0
            triangle = locate(vertices, triangles, int(state[_TRIANGLE]), x, y, weights)
            state[_TRIANGLE] = triangle
            variance = interpolate_filter(
                vertices, triangles, triangle, level_kind, weights, lsf, ar, work
            )
            state[_ORDER] = order
            state[_DEVIATION] = np.sqrt(variance)
        deviation = state[_DEVIATION]
        contraction = 1.0 if deviation > 0.0 else release
        output[index] = _step(state, deviation * noise[index], contraction, limit)
