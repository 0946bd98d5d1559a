"""Blocks of surfaces whose processes are known, for the tests of several surfaces."""

import numpy as np
from scipy.signal import lfilter

from mmt.core.arrays import FloatArray
from mmt.texture.surfaces import SurfaceBlock
from mmt.texture.surfaces.blocks import BLOCK, band_log_power

SMOOTH = np.array([-0.9])
PEAKED = np.array([-1.2, 0.8])


def power_law(inputs: FloatArray) -> float:
    """Return the amplitude of a usual texture at log speed and log force."""
    return float(np.exp(0.5 * (1.1 * inputs[0] + 0.65 * inputs[1])))


def make_blocks(
    ar: FloatArray,
    count: int,
    seed: int,
    *,
    amplitude: float = 1.0,
    low: tuple[float, float] = (-1.2, -1.2),
    high: tuple[float, float] = (0.9, 0.9),
    first: int = 0,
) -> list[SurfaceBlock]:
    """Draw blocks of an autoregressive process whose level follows a power law."""
    random = np.random.default_rng(seed)
    blocks = []
    for number in range(first, first + count):
        inputs = random.uniform(low, high)
        noise = random.standard_normal(BLOCK + 200)
        vibration = lfilter([1.0], np.r_[1.0, ar], noise)[200:]
        vibration *= amplitude * power_law(inputs)
        blocks.append(
            SurfaceBlock(
                start=number * BLOCK,
                stop=(number + 1) * BLOCK,
                inputs=inputs,
                log_power=band_log_power(vibration[:, None]),
                touchdown=number == 0,
                contact_start=0,
            )
        )
    return blocks
