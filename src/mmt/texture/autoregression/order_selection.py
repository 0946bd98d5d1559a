"""Choice of one autoregressive order for all segments of a texture."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from annotated_types import Le

from mmt.core.arrays import FloatArray
from mmt.core.bounds import check
from mmt.texture.autoregression.burg import burg_batch
from mmt.texture.autoregression.order_limit import Order

_LEAST_SHARE = 2.0**-104  # below the rounding of the samples, where Burg's method has stopped


def choose_order(segments: Sequence[FloatArray], largest: int = 24, smallest: int = 4) -> int:
    """Choose the common order of a texture from its first segments.

    The order p between `smallest` and `largest` with the least sum over segments of
    ``n CIC(p)``, n the segment's length and CIC Broersen's combined information criterion::

        CIC(p) = ln(variance(p)) + max(prod (1 + v_i)/(1 - v_i) - 1, 3 sum v_i)
        v_i = 1 / (n + 1 - i), i = 1 ... p

    whose v_i are the finite-sample variances of Burg's reflection coefficients. It neither
    follows the noise at orders near the segment's length, as AIC and AICc do, nor misses
    weak details, as BIC does. All orders come from one fit of the largest.

    Segments of zero power say nothing; if there are no others, the result is `smallest`.

    Parameters
    ----------
    segments
        Each of shape (n,) with n greater than `largest`.
    largest, smallest
        Bounds of the order, within 1 to 64.

    Raises
    ------
    InputError
        The bounds cross, or as `burg_batch`.

    References
    ----------
    Broersen, "Finite sample criteria for autoregressive order selection", IEEE Trans. Signal
    Process. 48 (2000), 3550-3558.
    """
    check("largest", largest, Order)
    check("smallest", smallest, Annotated[Order, Le(largest)])
    variances = burg_batch(segments, largest).variances
    total = np.zeros(largest)
    for segment, row in zip(segments, variances, strict=True):
        if row[0] > 0.0:
            share = np.maximum(row[1:] / row[0], _LEAST_SHARE)
            total += len(segment) * (np.log(share) + _penalty(len(segment), largest))
    return smallest + int(np.argmin(total[smallest - 1 :]))


def _penalty(samples: int, largest: int) -> FloatArray:
    """Return CIC's penalty for the orders 1 ... largest."""
    v = 1.0 / (samples - np.arange(largest))
    finite_sample = np.cumprod((1.0 + v) / (1.0 - v)) - 1.0
    penalty: FloatArray = np.maximum(finite_sample, 3.0 * np.cumsum(v))
    return penalty
