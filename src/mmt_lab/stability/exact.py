"""Burg's method in decimal arithmetic of many digits: the reference for the stiff cases.

The plain textbook recursion; what it loses to cancellation it has to spare. Needs nothing
but the standard library. Cost: about 1 us a sample and order.
"""

from collections.abc import Sequence
from decimal import Decimal, localcontext
from typing import Final

from mmt.core.arrays import FloatArray

_DIGITS: Final = 120
_HIGHEST_EXPONENT: Final = 999_999


def exact_burg(x: FloatArray, order: int) -> tuple[list[Decimal], Decimal]:
    """Return the reflection coefficients (m,) of a signal (n,) and their residual.

    A residual that is exactly zero ends the recursion with coefficients of zero. For the
    residual see `exact_residual`.
    """
    with localcontext(prec=_DIGITS, Emax=_HIGHEST_EXPONENT, Emin=-_HIGHEST_EXPONENT):
        forward = backward = [Decimal(value) for value in x.tolist()]
        reflection = []
        for _ in range(order):
            ahead, behind = forward[1:], backward[:-1]
            total = sum((f * f + b * b for f, b in zip(ahead, behind, strict=True)), Decimal())
            product = sum((f * b for f, b in zip(ahead, behind, strict=True)), Decimal())
            k = -2 * product / total if total else Decimal()
            reflection.append(k)
            forward = [f + k * b for f, b in zip(ahead, behind, strict=True)]
            backward = [b + k * f for f, b in zip(ahead, behind, strict=True)]
        return reflection, _mean_square(forward, backward)


def exact_residual(x: FloatArray, reflection: Sequence[float] | FloatArray) -> Decimal:
    """Return what given coefficients leave of a signal (n,).

    The mean square of the forward and backward prediction errors over the n - m samples that
    have both.
    """
    with localcontext(prec=_DIGITS, Emax=_HIGHEST_EXPONENT, Emin=-_HIGHEST_EXPONENT):
        forward = backward = [Decimal(value) for value in x.tolist()]
        for value in reflection:
            k = Decimal(float(value))
            ahead, behind = forward[1:], backward[:-1]
            forward = [f + k * b for f, b in zip(ahead, behind, strict=True)]
            backward = [b + k * f for f, b in zip(ahead, behind, strict=True)]
        return _mean_square(forward, backward)


def _mean_square(forward: Sequence[Decimal], backward: Sequence[Decimal]) -> Decimal:
    squares = sum((value * value for value in (*forward, *backward)), Decimal())
    return squares / (2 * len(forward))
