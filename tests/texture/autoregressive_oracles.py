"""Textbook definitions in arithmetic of many digits: those of the bench, and some more."""

import mpmath
import numpy as np

from mmt_lab.bench.references import (  # noqa: F401 - for the tests
    DIGITS,
    burg,
    exact,
    largest_error,
    lsf_to_ar,
    refine_lsf,
    step_down,
    step_up,
)


def inverse_gain(reflection):
    with mpmath.workdps(DIGITS):
        return mpmath.fprod(1 - k * k for k in reflection)


def relative_error(found, expected):
    with mpmath.workdps(DIGITS):
        return float(abs(mpmath.mpf(float(found)) / expected - 1))


def low_pass_lsf(order, share=0.2):
    """Return frequencies in the lowest part of (0, pi): the worst case for coefficients."""
    return share * np.pi / (order + 1) * np.arange(1, order + 1)


def spread_lsf(order, seed=0):
    """Return unevenly spread frequencies over (0, pi)."""
    generator = np.random.default_rng(seed)
    return np.pi / (order + 1) * (np.arange(1, order + 1) + generator.uniform(-0.4, 0.4, order))
