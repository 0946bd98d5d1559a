"""Burg's method on signals that break other implementations, against 120 digits."""

import math
from collections.abc import Mapping, Sequence
from decimal import Decimal, localcontext
from functools import partial
from typing import Final

import numpy as np
from scipy.signal import sosfilt

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.burg import burg
from mmt.texture.autoregression.forms import reflection_to_lsf
from mmt_lab.stability.families import CaseResult, Extreme, Family

CLUSTERED_RAD: Final = (0.05, 0.0525, 0.055, 0.0575, 0.06)
SPREAD_RAD: Final = (0.3, 0.8, 1.4, 2.0, 2.7)
RADII: Final = (0.9, 0.99, 0.999, 0.9999, 0.99999, 0.999999)
ORDERS: Final = (1, 2, 3, 8, 16, 32, 64)

_DIGITS: Final = 120
_HIGHEST_EXPONENT: Final = 999_999
_SAMPLES: Final = 400
_ORDER: Final = 16
_RATE_HZ: Final = 1000.0
_RELATIVE: Final = 1e-4
_VANISHED: Final = 1e-28
_EXPECTED: Final = "stable, residual as exact to 1e-4 or under 1e-28 of the power"


def cases() -> list[Extreme]:
    """Return the family's cases."""
    rows = [
        *(
            (f"five pole pairs at radius {radius:g}, {name}", poles(radius, angles), 10)
            for name, angles in (("clustered", CLUSTERED_RAD), ("spread", SPREAD_RAD))
            for radius in RADII
        ),
        *((what, x, _ORDER) for what, x in signals().items()),
        ("pure sinusoid, order 64", signals()["pure sinusoid"], 64),
        *((f"white noise, order {order}", white(), order) for order in ORDERS),
        *((f"{order + 1} samples, order {order}", white()[: order + 1], order) for order in ORDERS),
    ]
    return [Extreme(what, _EXPECTED, partial(_fit, x, order)) for what, x, order in rows]


def white() -> FloatArray:
    """Return white noise, shape (400,)."""
    return np.random.default_rng(1).standard_normal(_SAMPLES)


def poles(
    radius: float | Sequence[float],
    angles_rad: Sequence[float],
    *,
    samples: int = _SAMPLES,
    seed: int = 2,
) -> FloatArray:
    """Return noise through pole pairs, at one radius or one each, after 2600 samples, (samples,).

    Filtered in second-order sections: the whole filter's coefficients would not hold the poles.
    """
    sections = [
        (1.0, 0.0, 0.0, 1.0, -2.0 * r * math.cos(angle), r * r)
        for r, angle in zip(np.broadcast_to(radius, len(angles_rad)), angles_rad, strict=True)
    ]
    noise = np.random.default_rng(seed).standard_normal(2600 + samples)
    settled: FloatArray = sosfilt(np.array(sections), noise)[-samples:]
    return settled


def signals() -> Mapping[str, FloatArray]:
    """Return the signals that are not defined by poles alone, by their names."""
    n = np.arange(_SAMPLES)
    time_s = np.arange(1000) / _RATE_HZ
    vibration = poles(0.98, SPREAD_RAD)
    pair = np.sin(2.0 * np.pi * 100.0 * time_s) + np.sin(2.0 * np.pi * 100.1 * time_s + 1.0)
    steps = 127.0 / np.abs(vibration).max()
    return {
        "pure sinusoid": np.sin(0.3 * n),
        "two sinusoids 0.1 Hz apart": pair,
        "two sinusoids 0.1 Hz apart in noise": pair + 1e-3 * np.resize(white(), 1000),
        "constant": np.ones(_SAMPLES),
        "zero": np.zeros(_SAMPLES),
        "impulse": np.where(n == _SAMPLES // 2, 1.0, 0.0),
        "step": np.where(n >= _SAMPLES // 2, 1.0, 0.0),
        "offset of 1e6 and white noise": 1e6 + white(),
        "quantised to 8 bits": np.round(vibration * steps),
        "slow sinusoid quantised to 8 bits": np.round(127.0 * np.sin(0.01 * n)),
        "clipped at 0.3 of its deviation": np.clip(
            vibration, -0.3 * vibration.std(), 0.3 * vibration.std()
        ),
    }


def _fit(x: FloatArray, order: int) -> CaseResult:
    fit = burg(x, order)
    problem = _unsound(fit.reflection, fit.variances)
    if problem:
        return CaseResult(problem, held=False)
    expected, best = exact_burg(x, order)
    left, power = exact_residual(x, fit.reflection), exact_residual(x, [])
    share = float(left / power) if power else 0.0
    excess = float(abs(left - best) / best) if best else math.inf * share if share else 0.0
    error = max(
        abs(float(exact - Decimal(float(k))))
        for exact, k in zip(expected, fit.reflection, strict=True)
    )
    if share < _VANISHED:
        got = f"stable, residual {share:.0e} of the power"
    else:
        got = f"stable, residual off by {excess:.0e}, k by {error:.0e}"
    return CaseResult(
        got,
        held=share < _VANISHED or excess <= _RELATIVE,
        figures={"residual_excess": excess, "residual_share": share, "largest_k_error": error},
    )


def _unsound(reflection: FloatArray, variances: FloatArray) -> str:
    """Return why a fit is no usable filter, or an empty string if it is one."""
    if not (np.abs(reflection) < 1.0).all():
        return f"not stable: |k| = {np.abs(reflection).max()}"
    if not (np.isfinite(variances).all() and (variances >= 0.0).all()):
        return "a variance is negative or not finite"
    lsf = reflection_to_lsf(reflection)
    if not (np.diff(lsf, prepend=0.0, append=np.pi) > 0.0).all():
        return "line spectral frequencies that do not ascend"
    return ""


def exact_burg(x: FloatArray, order: int) -> tuple[list[Decimal], Decimal]:
    """Return the reflection coefficients (m,) of a signal (n,) and their residual, in 120 digits.

    The plain textbook recursion: the digits make up for the losses by cancellation. It takes about
    1 us a sample and order.

    A residual that is exactly zero ends the recursion with coefficients of zero. For the
    residual see `exact_residual`.
    """
    return _recursion(x, [None] * order)


def exact_residual(x: FloatArray, reflection: Sequence[float] | FloatArray) -> Decimal:
    """Return the residual of a signal (n,) for given reflection coefficients (m,).

    The residual is the mean square of the forward and backward prediction errors, over the n - m
    samples that have both.
    """
    return _recursion(x, [float(k) for k in reflection])[1]


def _recursion(x: FloatArray, given: Sequence[float | None]) -> tuple[list[Decimal], Decimal]:
    """Return coefficients and residual; a coefficient that is None is Burg's."""
    with localcontext(prec=_DIGITS, Emax=_HIGHEST_EXPONENT, Emin=-_HIGHEST_EXPONENT):
        forward = backward = [Decimal(value) for value in x.tolist()]
        reflection = []
        for value in given:
            pairs = list(zip(forward[1:], backward[:-1], strict=True))
            if value is None:
                total = sum((f * f + b * b for f, b in pairs), Decimal())
                product = sum((f * b for f, b in pairs), Decimal())
                k = -2 * product / total if total else Decimal()
            else:
                k = Decimal(value)
            reflection.append(k)
            forward, backward = [f + k * b for f, b in pairs], [b + k * f for f, b in pairs]
        squares = sum((value * value for value in (*forward, *backward)), Decimal())
        return reflection, squares / (2 * len(forward))


FAMILY: Final = Family("Fits of difficult signals, against 120 digits", cases)
