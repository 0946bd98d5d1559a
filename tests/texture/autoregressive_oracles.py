"""Textbook definitions in multi-precision arithmetic."""

import warnings

import mpmath
import numpy as np

DIGITS = 200


def exact(values):
    return [mpmath.mpf(float(value)) for value in values]


def burg(x, order):
    """Return reflection coefficients and the residual variances of orders 0 ... order."""
    with mpmath.workdps(DIGITS):
        forward = exact(x)
        backward = list(forward)
        variances = [sum(value * value for value in forward) / len(forward)]
        reflection = []
        for _ in range(order):
            forward, backward = forward[1:], backward[:-1]
            total = sum(f * f + b * b for f, b in zip(forward, backward, strict=True))
            cross = sum(f * b for f, b in zip(forward, backward, strict=True))
            k = -2 * cross / total
            forward, backward = lattice(forward, backward, k)
            reflection.append(k)
            variances.append(variances[-1] * (1 - k * k))
        return reflection, variances


def lattice(forward, backward, k):
    pairs = list(zip(forward, backward, strict=True))
    return [f + k * b for f, b in pairs], [b + k * f for f, b in pairs]


def residual(x, reflection):
    """Return the mean square that these reflection coefficients leave of a signal."""
    with mpmath.workdps(DIGITS):
        forward = exact(x)
        backward = list(forward)
        for k in reflection:
            forward, backward = lattice(forward[1:], backward[:-1], mpmath.mpf(k))
        return sum(value * value for value in forward + backward) / (2 * len(forward))


def _multiply(a, b):
    result = [mpmath.mpf(0)] * (len(a) + len(b) - 1)
    for i, left in enumerate(a):
        for j, right in enumerate(b):
            result[i + j] += left * right
    return result


def lsf_to_ar(lsf):
    """Return the coefficients without the leading 1, from the products that define P and Q."""
    with mpmath.workdps(DIGITS):
        p, q = [mpmath.mpf(1)], [mpmath.mpf(1)]
        for index, frequency in enumerate(exact(lsf)):
            factor = [mpmath.mpf(1), -2 * mpmath.cos(frequency), mpmath.mpf(1)]
            if index % 2 == 0:
                p = _multiply(p, factor)
            else:
                q = _multiply(q, factor)
        if len(lsf) % 2 == 0:
            p, q = _multiply(p, [1, 1]), _multiply(q, [1, -1])
        else:
            q = _multiply(q, [1, 0, -1])
        return [(a + b) / 2 for a, b in zip(p, q, strict=True)][1 : len(lsf) + 1]


def step_down(ar):
    """Return the reflection coefficients."""
    with mpmath.workdps(DIGITS):
        rest = list(ar)
        reflection = []
        while rest:
            k = rest[-1]
            reflection.append(k)
            count = len(rest) - 1
            rest = [(rest[j] - k * rest[count - 1 - j]) / (1 - k * k) for j in range(count)]
        return reflection[::-1]


def step_up(reflection):
    """Return the coefficients without the leading 1."""
    with mpmath.workdps(DIGITS):
        ar = []
        for k in (mpmath.mpf(value) for value in reflection):
            ar = [left + k * right for left, right in zip(ar, ar[::-1], strict=True)] + [k]
        return ar


def ar_to_lsf(ar):
    """Return the angles of the zeros of P and Q, by a polynomial root finder."""
    with mpmath.workdps(60):
        whole = [mpmath.mpf(1), *ar, mpmath.mpf(0)]
        angles = []
        for sign in (1, -1):
            polynomial = [a + sign * b for a, b in zip(whole, whole[::-1], strict=True)]
            with warnings.catch_warnings():  # newer versions ask for the order of powers,
                warnings.simplefilter("ignore", DeprecationWarning)  # older do not know it
                roots = mpmath.polyroots(polynomial, maxsteps=500, extraprec=400)
            angles += [mpmath.arg(root) for root in roots]
        tiny = mpmath.mpf(10) ** -30
        return sorted(angle for angle in angles if tiny < angle < mpmath.pi - tiny)


def inverse_gain(reflection):
    with mpmath.workdps(DIGITS):
        return mpmath.fprod(1 - k * k for k in reflection)


def largest_error(found, expected):
    """Return the largest absolute difference of floats from multi-precision numbers."""
    with mpmath.workdps(DIGITS):
        differences = [abs(a - b) for a, b in zip(exact(found), expected, strict=True)]
        return float(max(differences))


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
