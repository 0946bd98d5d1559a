"""Matched filter for damped tones: the energy of a struck object in a segment.

A struck object rings in its modes, each a damped sinusoid from the instant of the knock. Against a
texture of known spectrum the most powerful test for one of them is the matched filter behind the
prediction error filter of the texture (Kay, "Fundamentals of statistical signal processing", volume
II, 1998, section 7.4): the squared projection of the prediction error on the filtered cosine and
sine. Mode and instant are unknown, so the largest over a grid is taken, a generalised likelihood
ratio. It also detects tones at the frequencies of the texture itself: behind the filter, such a
tone leaves the click of its onset.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel

ComplexArray = npt.NDArray[np.complex128]

MODES_PER_SAMPLE: Final = np.geomspace(0.025, 0.33, 24)
"""Frequencies of the modes in cycles a sample."""

DECAY: Final = 25.0
"""Samples in which a mode falls to 1/e. Tones twice or half as long are detected nearly as well."""

_SHORTEST: Final = 8  # samples that a mode must have left in the segment
_LEAST: Final = 1e-9  # of the determinant: cosine and sine that cannot be told apart


def modes() -> ComplexArray:
    """Return the grid of modes as factors from one sample to the next."""
    return np.asarray(np.exp(-1.0 / DECAY + 2j * np.pi * MODES_PER_SAMPLE))


@kernel("void(f8[::1], f8[::1], f8[::1])")
def _led_back(error: FloatArray, ar: FloatArray, back: FloatArray) -> None:
    """Filter the prediction error in reversed time."""
    for n in range(error.size):
        total = error[n]
        for j in range(min(ar.size, error.size - n - 1)):
            total += ar[j] * error[n + j + 1]
        back[n] = total


@kernel("void(f8[:, ::1], f8)")
def _step(state: FloatArray, sample: float) -> None:
    """Advance all modes by one sample.

    Rows of the state (10, k): the mode, its inner product with what has been led back, the sums
    of ``|w|^2`` and of ``w^2`` over the filtered mode w, the next sample of w, each complex but
    the fifth, and the largest energy so far. No mode waits for another, so that the compiler
    takes several at once.
    """
    for k in range(state.shape[1]):
        real, imag = state[0, k], state[1, k]
        inner_real = sample + real * state[2, k] - imag * state[3, k]
        inner_imag = real * state[3, k] + imag * state[2, k]
        state[2, k], state[3, k] = inner_real, inner_imag
        w_real, w_imag = state[7, k], state[8, k]
        state[4, k] += w_real * w_real + w_imag * w_imag
        state[5, k] += w_real * w_real - w_imag * w_imag
        state[6, k] += 2.0 * w_real * w_imag
        state[7, k] = real * w_real - imag * w_imag
        state[8, k] = real * w_imag + imag * w_real
        cosine = 0.5 * (state[4, k] + state[5, k])
        sine = 0.5 * (state[4, k] - state[5, k])
        cross = 0.5 * state[6, k]
        determinant = cosine * sine - cross * cross
        explained = sine * inner_real * inner_real + cosine * inner_imag * inner_imag
        explained = (explained - 2.0 * cross * inner_real * inner_imag) / determinant
        explained = explained if determinant > _LEAST * cosine * sine else 0.0
        state[9, k] = explained if explained > state[9, k] else state[9, k]


@kernel("f8(f8[::1], f8[::1], c16[::1])")
def loudest_tone_energy(error: FloatArray, ar: FloatArray, grid: ComplexArray) -> float:
    """Return the largest energy of the error that one damped tone explains.

    Parameters
    ----------
    error
        Prediction error, shape (n,).
    ar
        The filter that it comes from, without the leading 1, shape (m,).
    grid
        See `modes`, shape (k,).

    Notes
    -----
    O(n (m + k)): all instants of one mode are a recursion in reversed time. Every mode decays,
    so that it is stable.
    """
    if error.size < _SHORTEST:
        return 0.0
    back = np.empty(error.size)
    _led_back(error, ar, back)
    part = np.ones(grid.size, dtype=np.complex128)  # the filter at the mode, as far as it goes
    power, tone = part.copy(), part.copy()
    state = np.zeros((10, grid.size))
    state[0], state[1] = grid.real, grid.imag
    for left in range(error.size):
        if left <= ar.size:
            for k in range(grid.size):
                if left > 0:
                    power[k] /= grid[k]
                    part[k] += ar[left - 1] * power[k]
                    tone[k] *= grid[k]
                state[7, k] = (tone[k] * part[k]).real
                state[8, k] = (tone[k] * part[k]).imag
        if left == _SHORTEST - 1:
            state[9] = 0.0  # what began later has too little left to tell
        _step(state, back[error.size - 1 - left])
    return float(state[9].max())
