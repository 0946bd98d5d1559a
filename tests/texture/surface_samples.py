"""Blocks of surfaces whose processes are known, for the tests of several surfaces."""

import numpy as np
from scipy.signal import lfilter

from mmt.texture.field.covariance import coordinates
from mmt.texture.surfaces.blocks import MEANS, SurfaceBlock, spectrum_components

BLOCK = 50
"""Samples of a block."""

SMOOTH = np.array([-0.9])
PEAKED = np.array([-1.2, 0.8])


def make_blocks(
    ar, count, seed, *, gain=1.0, low=(0.1, 0.1), high=(0.9, 0.9), first=0, heading=0.0
):
    """Draw blocks of an autoregressive process whose level follows a power law.

    Every fourth one begins another stroke, at normalised speed and force from `low` to `high`.
    """
    random = np.random.default_rng(seed)
    blocks = []
    stroke = random.uniform(low, high)
    for number in range(first, first + count):
        if number % 4 == 0:
            stroke = random.uniform(low, high)
        at = coordinates(stroke[None])
        noise = random.standard_normal(BLOCK + 200)
        vibration = lfilter([1.0], np.r_[1.0, ar], noise)[200:]
        vibration *= 0.1 * gain * np.exp(0.5 * at.law[0])
        values = spectrum_components(vibration[None, :, None])[0] - MEANS
        values[0] -= at.law[0]
        blocks.append(
            SurfaceBlock(
                start=number * BLOCK,
                stop=(number + 1) * BLOCK,
                stroke=np.array([at.u[0], at.v[0], heading]),
                values=values,
                touchdown=number == 0,
                contact_start=0,
            )
        )
    return blocks
