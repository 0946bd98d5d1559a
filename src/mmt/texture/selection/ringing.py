"""How much of a segment a struck object explains: a matched filter for damped tones.

What is struck rings in its modes, each a damped sinusoid from the instant of the blow. Against a
texture of known spectrum the most powerful test for one of them is the matched filter behind the
prediction error filter of the texture (Kay, "Fundamentals of statistical signal processing",
volume II, 1998, section 7.4): the squared projection of the prediction error on the filtered
cosine and sine. Mode and instant being unknown, the largest over a grid is taken, a
generalised likelihood ratio. It also hears what rings just where the texture has its energy: led
through the texture's filter, such a tone leaves the click of its beginning.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from mmt.arrays import FloatArray
from mmt.compiled import kernel

ComplexArray = npt.NDArray[np.complex128]

MODES_PER_SAMPLE: Final = np.geomspace(0.025, 0.33, 24)
"""Frequencies of the modes in cycles a sample."""

DECAY: Final = 25.0
"""Samples in which a mode falls to 1/e. A tone twice or half as long is heard nearly as well."""

_SHORTEST: Final = 8  # samples that a mode must have left in the segment
_LEAST: Final = 1e-9  # of the determinant: cosine and sine that cannot be told apart


def modes() -> ComplexArray:
    """Return the grid of modes as factors from one sample to the next."""
    return np.asarray(np.exp(-1.0 / DECAY + 2j * np.pi * MODES_PER_SAMPLE))


@kernel("void(c16, f8[::1], f8[::1], c16[::1])")
def _measure(mode: complex, ar: FloatArray, energy: FloatArray, square: ComplexArray) -> None:
    """Write the sums of ``|w|^2`` and ``w^2`` over the first samples of the filtered mode w."""
    tone, part, power = 1.0 + 0.0j, 1.0 + 0.0j, 1.0 + 0.0j
    energy[0], square[0] = 0.0, 0.0
    for n in range(energy.size - 1):
        if 0 < n <= ar.size:
            power /= mode
            part += ar[n - 1] * power
        filtered = tone * part
        energy[n + 1] = energy[n] + filtered.real**2 + filtered.imag**2
        square[n + 1] = square[n] + filtered * filtered
        tone *= mode


@kernel("void(f8[::1], f8[::1], f8[::1])")
def _led_back(error: FloatArray, ar: FloatArray, back: FloatArray) -> None:
    """Lead the prediction error through the filter in reversed time."""
    for n in range(error.size):
        total = error[n]
        for j in range(min(ar.size, error.size - n - 1)):
            total += ar[j] * error[n + j + 1]
        back[n] = total


@kernel("f8(f8[::1], f8[::1], c16[::1])")
def loudest_ring(error: FloatArray, ar: FloatArray, grid: ComplexArray) -> float:
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
    size = error.size
    back = np.empty(size)
    energy, square = np.empty(size + 1), np.empty(size + 1, dtype=np.complex128)
    _led_back(error, ar, back)
    best = 0.0
    for mode in grid:
        _measure(mode, ar, energy, square)
        inner = 0.0 + 0.0j
        for start in range(size - 1, -1, -1):
            inner = back[start] + mode * inner
            left = size - start
            if left < _SHORTEST:
                continue
            cosine = 0.5 * (energy[left] + square[left].real)
            sine = 0.5 * (energy[left] - square[left].real)
            cross = 0.5 * square[left].imag
            determinant = cosine * sine - cross * cross
            if determinant > _LEAST * cosine * sine:
                explained = sine * inner.real**2 + cosine * inner.imag**2
                explained -= 2.0 * cross * inner.real * inner.imag
                best = max(best, explained / determinant)
    return best
