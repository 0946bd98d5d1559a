"""Wavelet blocks of MPEG haptics: a waveform in blocks, each transformed, quantised and coded.

The wavelets are the biorthogonal ones with 9 and 7 taps of A. Cohen, I. Daubechies, J.-C.
Feauveau, "Biorthogonal bases of compactly supported wavelets", Comm. Pure Appl. Math. 45, 1992.
"""

import base64
import math
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt_bridges.haptics.spiht import MOST_PLANES, encode_block

_LOW: Final = (
    0.852698679009404,
    0.377402855612654,
    -0.110624404418423,
    -0.023849465019380,
    0.037828455506995,
)
"""The symmetric low-pass filter, from its middle outwards."""

_HIGH: Final = (-0.788485616405665, 0.418092273222212, 0.040689417609559, -0.064538882628938)

_COARSEST: Final = 4  # coefficients of the coarsest band
_FINEST_STEP: Final = 2.0**-15  # of full scale, as in 16-bit sound
_SMALL_SCALE: Final = 128  # steps per unit, for a scale up to 127/128
_LARGE_SCALE: Final = 8  # steps per unit, for a scale from 1


def wavelet_streams(samples: FloatArray, block: int) -> list[str]:
    """Return the coded blocks of a waveform, as text in base 64.

    Parameters
    ----------
    samples
        Within -1 and 1; shape (n,). The last block is filled up with zeros.
    block
        Samples of a block: a power of two, 16 to 1024.
    """
    count = -(-len(samples) // block)
    blocks = np.zeros((count, block))
    blocks.reshape(-1)[: len(samples)] = samples
    return [_stream(each) for each in transform(blocks)]


def transform(blocks: FloatArray) -> FloatArray:
    """Return the wavelet coefficients of blocks, coarsest band first; shape (m, n) as given.

    Each block is continued by its mirror image at both ends.
    """
    coefficients = np.array(blocks, float)
    width = blocks.shape[1]
    while width > _COARSEST:
        low = _filtered(coefficients[:, :width], _LOW)[:, ::2]
        high = _filtered(coefficients[:, :width], _HIGH)[:, 1::2]
        coefficients[:, :width] = np.concatenate([low, high], axis=1)
        width //= 2
    return coefficients


def _filtered(blocks: FloatArray, half: tuple[float, ...]) -> FloatArray:
    reach, width = len(half) - 1, blocks.shape[1]
    wide = np.pad(blocks, ((0, 0), (reach, reach)), "reflect")
    result = half[0] * blocks
    for offset in range(1, reach + 1):
        left = wide[:, reach - offset : reach - offset + width]
        result += half[offset] * (left + wide[:, reach + offset : reach + offset + width])
    return result


def _stream(coefficients: FloatArray) -> str:
    largest = float(np.abs(coefficients).max())
    planes, code, scale = _scaling(largest)
    if largest < scale * 2.0 ** (-1 - planes):
        return ""  # all would round to zero: silence
    most = (1 << planes) - 1
    values = np.clip(np.rint(coefficients / scale * 2.0**planes), -most, most).astype(np.int64)
    # Without the padding of base 64: the reference decoder takes it for bits.
    return base64.b64encode(encode_block(values, planes, code)).decode().rstrip("=")


def _scaling(largest: float) -> tuple[int, int, float]:
    """Return bit planes, the header's 8 bits for the scale, and the scale, at least `largest`."""
    if largest <= 1.0 - 1.0 / _SMALL_SCALE:
        steps = max(1, math.ceil(largest * _SMALL_SCALE))
        code, scale = steps << 1, steps / _SMALL_SCALE
    else:
        steps = min(max(0, math.ceil((largest - 1.0) * _LARGE_SCALE)), 127)
        code, scale = steps << 1 | 1, 1.0 + steps / _LARGE_SCALE
    planes = math.ceil(math.log2(scale / _FINEST_STEP))
    return min(planes, MOST_PLANES), code, scale
