"""Burg's method: reflection coefficients and residual variances of segments.

Burg, "Maximum entropy spectral analysis", thesis, Stanford 1975. For the recursion, and why it is
accurate on every finite signal, see `mmt.texture.autoregression.burg_recursion`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.bounds import check, real_numbers
from mmt.core.errors import InputError
from mmt.texture.autoregression.burg_recursion import burg_each_into
from mmt.texture.autoregression.order_limit import Order


class ReflectionFits(NamedTuple):
    """A model fitted to one segment, or models fitted to s segments.

    ``reflection`` (m,) or (s, m); ``variances`` (m + 1,) or (s, m + 1): the mean squares of the
    residuals of orders 0 ... m.
    """

    reflection: FloatArray
    variances: FloatArray

    @property
    def variance(self) -> FloatArray:
        """Variance of the excitation of each, () or (s,): the residual of the full order."""
        return np.asarray(self.variances[..., -1])

    @property
    def power(self) -> FloatArray:
        """Mean square of each segment, () or (s,), which is that of the model's output."""
        return np.asarray(self.variances[..., 0])


def burg(x: FloatArray, order: int) -> ReflectionFits:
    """Fit an autoregressive model by Burg's method.

    The mean is not removed. The fit is stable for every finite signal: each ``|k| < 1``, the
    variances finite and not negative. A signal that is predicted to its last digit (zero,
    constant, a pure tone) ends the recursion: further reflection coefficients are zero.
    Amplitudes from denormal to 1e300 give the same reflection coefficients; variances are
    limited to the largest floating-point number.

    Parameters
    ----------
    x : (n,)
        The segment, n greater than `order`.
    order
        From 1 to 64.

    Raises
    ------
    InputError
        A sample is not finite, the order is out of range, or the segment is too short.
    """
    fits = burg_batch([x], order)
    return ReflectionFits(fits.reflection[0], fits.variances[0])


def burg_batch(segments: Sequence[FloatArray] | FloatArray, order: int) -> ReflectionFits:
    """Fit an autoregressive model to each segment, as `burg` does.

    Parameters
    ----------
    segments
        Arrays of equal or different lengths, or the rows of an array (s, n).
    order
        From 1 to 64.

    Raises
    ------
    InputError
        As `burg`; the message names the segment.
    """
    check("order", order, Order)
    arrays = [real_numbers(f"segment {k}", segment) for k, segment in enumerate(segments)]
    for index, array in enumerate(arrays):
        if array.ndim != 1 or len(array) <= order:
            raise InputError(
                f"segment {index} has shape {array.shape}: order {order} needs one row of more than"
                f" {order} samples"
            )
    reflection = np.empty((len(arrays), order))
    variances = np.empty((len(arrays), order + 1))
    if arrays:
        stops = np.cumsum([len(array) for array in arrays], dtype=np.int64)
        fitted = burg_each_into(np.concatenate(arrays), stops, reflection, variances)
        if fitted < len(arrays):
            raise InputError(f"segment {fitted} has a sample that is not finite: leave it out")
    return ReflectionFits(reflection, variances)
