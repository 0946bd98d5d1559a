"""Autoregressive fits and their forms: reflection, filter coefficients, line spectral frequencies.

Awan et al., section V.C, and Culbertson et al. 2014 model a piece of vibration as white noise
through an all-pole filter, ``x[n] + sum_j a[j] x[n-1-j] = e[n]``. Every form below is of shape
(m,) for one model or (n, m) for a batch, of order m from 1 to 64, odd or even:

- reflection coefficients, which Burg's method finds, each of magnitude below one;
- filter coefficients, without the leading 1;
- line spectral frequencies in radians a sample, strictly ascending in (0, pi); they can be
  interpolated, since an average of ordered frequencies is ordered, hence stable.

A line spectral frequency is accurate to a rounding of itself. A filter given by its frequencies is
recovered to about 1e-14, near the unit circle to 1e-11. But there neighbouring frequencies are so
close that roundings decide which filter they give. Converting reflection coefficients to
frequencies and back changes ``1 - |k|`` by a relative error of some 1e-16, at most 4e-15, over the
least gap between two of the frequencies, 0 and pi included. At order 16 with coefficients drawn
evenly the error is 4e-12 in the median. With every ``|k|`` above 0.9 it is 2e-3, and in one filter
of five ``1 - |k|`` is lost. Even then the filter is stable, with its lines in place, and so it is
accepted: a pure tone must not end a model. If ``1 - |k|`` matters, keep reflection coefficients.

Filter coefficients are less accurate: a conversion from them multiplies the error by a factor of up
to ``prod (1 + |k|)/(1 - |k|)``. For a low-pass filter of high order nothing is left.
"""

from collections.abc import Callable

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.bounds import real_numbers
from mmt.core.errors import InputError
from mmt.texture.autoregression import LARGEST_ORDER
from mmt.texture.autoregression.lsf import (
    ar_to_reflection_each_into,
    lsf_inverse_gain_each_into,
    lsf_to_ar_each_into,
    reflection_to_ar_each_into,
)
from mmt.texture.autoregression.reshaping import TINY
from mmt.texture.autoregression.split import (
    lsf_to_reflection_each_into,
    reflection_to_lsf_each_into,
)


def reflection_to_ar(reflection: FloatArray) -> FloatArray:
    """Return the filter coefficients of reflection coefficients (the Levinson step-up).

    Raises
    ------
    InputError
        A coefficient's magnitude is not below one, or the order is out of range.
    """
    return _convert(_checked_reflection(reflection), reflection_to_ar_each_into)


def ar_to_reflection(ar: FloatArray) -> FloatArray:
    """Return the reflection coefficients of filter coefficients (the Levinson step-down).

    The error is up to about ``1e-16 prod (1 + |k|)/(1 - |k|)``.

    Raises
    ------
    InputError
        A filter is not stable, within that error, or the order is out of range.
    """

    def step_down(rows: FloatArray, result: FloatArray) -> None:
        if ar_to_reflection_each_into(rows, result) == np.inf:
            raise InputError(
                "ar: the filter is not stable, or so near to it that its coefficients do not"
                " tell: give reflection coefficients or line spectral frequencies"
            )

    return _convert(_checked("ar", ar), step_down)


def reflection_to_lsf(reflection: FloatArray) -> FloatArray:
    """Return the line spectral frequencies of reflection coefficients; error about 1e-15.

    See `mmt.texture.autoregression.split` for the method. Frequencies closer than a rounding are
    moved apart by one.

    Raises
    ------
    InputError
        A coefficient's magnitude is not below one, or the order is out of range.
    """
    return _convert(_checked_reflection(reflection), reflection_to_lsf_each_into)


def lsf_to_reflection(lsf: FloatArray) -> FloatArray:
    """Return the reflection coefficients of line spectral frequencies.

    The error is about 1e-14, near the unit circle 1e-11. For coefficients that were converted
    to frequencies before, see the module's docstring.

    Raises
    ------
    InputError
        The frequencies do not ascend strictly inside (0, pi), lie too close to each other to
        determine the filter, or the order is out of range.
    """
    result = _convert(_checked_lsf(lsf), lsf_to_reflection_each_into)
    if not np.isfinite(result).all():
        raise InputError("lsf: frequencies are too close to each other to tell the filter")
    return result


def lsf_to_ar(lsf: FloatArray) -> FloatArray:
    """Return the filter coefficients of line spectral frequencies.

    The error is about 1e-14 of the largest coefficient at order 64.

    Raises
    ------
    InputError
        The frequencies do not ascend strictly inside (0, pi), or the order is out of range.
    """
    return _convert(_checked_lsf(lsf), lsf_to_ar_each_into)


def output_power(variance: float | FloatArray, reflection: FloatArray) -> FloatArray:
    """Return the mean square of the output, ``variance / prod(1 - k^2)``.

    Parameters
    ----------
    variance : () or (n,)
        Variance of the excitation.
    reflection : (m,) or (n, m)
        Each of magnitude below one.

    Raises
    ------
    InputError
        A coefficient's magnitude is not below one, or the order is out of range.
    """
    k = _checked_reflection(reflection)
    power: FloatArray = np.asarray(variance) / np.prod((1.0 - k) * (1.0 + k), axis=-1)
    return power


def lsf_output_power(variance: FloatArray, lsf: FloatArray) -> FloatArray:
    """Return `output_power` (n,) of line spectral frequencies (n, m), much faster.

    It is finite, though huge, where two frequencies have merged.

    Raises
    ------
    InputError
        The frequencies do not ascend strictly inside (0, pi), or the order is out of range.
    """
    gain = np.empty(len(lsf))
    lsf_inverse_gain_each_into(_checked_lsf(lsf), gain)
    return np.asarray(variance / np.maximum(gain, TINY))


def _convert(
    values: FloatArray, convert_rows: Callable[[FloatArray, FloatArray], object]
) -> FloatArray:
    result = np.empty_like(values)
    convert_rows(np.atleast_2d(values), np.atleast_2d(result))
    return result


def _checked(name: str, values: FloatArray) -> FloatArray:
    array = np.require(real_numbers(name, values), requirements=["C", "W"])  # for compiled code
    if array.ndim not in {1, 2} or not 1 <= array.shape[-1] <= LARGEST_ORDER:
        raise InputError(
            f"{name} has shape {array.shape}: (m,) or (n, m) with m from 1 to {LARGEST_ORDER}"
            " is allowed"
        )
    if not np.isfinite(array).all():
        raise InputError(f"{name} has a value that is not finite")
    return array


def _checked_reflection(reflection: FloatArray) -> FloatArray:
    array = _checked("reflection", reflection)
    if (np.abs(array) >= 1.0).any():
        raise InputError("reflection: a magnitude is not below 1, so the filter is not stable")
    return array


def _checked_lsf(lsf: FloatArray) -> FloatArray:
    array = _checked("lsf", lsf)
    ascending = (array[..., 1:] > array[..., :-1]).all()
    if not (ascending and (array[..., 0] > 0.0).all() and (array[..., -1] < np.pi).all()):
        raise InputError("lsf must ascend strictly inside (0, pi)")
    return array
