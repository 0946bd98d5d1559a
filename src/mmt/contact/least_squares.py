"""Recursive least squares that forgets, and stays well conditioned when nothing is learned.

The covariance is kept as ``U D U'`` with U unit upper triangular and D diagonal, updated by
Bierman's method (*Factorization Methods for Discrete Sequential Estimation*, Academic Press,
1977, chapter V): it stays positive for every sequence of data, while rounding may make the plain
form indefinite. Exponential forgetting divides D by the forgetting factor at each sample.
Without excitation that would let D grow without bound ("wind-up"). Here no element of D may
exceed its initial value. If correlations still raise a parameter's variance beyond
`LARGEST_RISE` times its initial one, the covariance is reset and the parameters are kept. So
parameters that are not excited are at worst about as uncertain as at the start (bounded
covariance and covariance resetting: Goodwin and Sin, *Adaptive Filtering, Prediction and
Control*, 1984, section 3.3).
"""

import math
from typing import Final

Triple = tuple[float, float, float]

LARGEST_RISE: Final = 4.0
"""No variance exceeds its initial one by more than this factor after a sample."""


class RecursiveLeastSquares:
    """Fit ``y = theta . phi`` with three parameters, newer samples weighing more.

    Written out for three, a sample costs a third of what it costs in loops.

    Parameters
    ----------
    variances
        Initial variance of each parameter, above 0.
    noise_variance
        Variance of y's error, above 0.
    forgetting
        Factor by which the weight of older samples falls with each new one, above 0, to 1.
    start
        Initial parameters.
    """

    def __init__(
        self,
        variances: Triple,
        *,
        noise_variance: float,
        forgetting: float,
        start: Triple = (0.0, 0.0, 0.0),
    ) -> None:
        self._initial = variances
        self._noise = noise_variance
        self._forgetting = forgetting
        self._d: Triple = variances
        self._u: Triple = (0.0, 0.0, 0.0)
        self.parameters: Triple = start
        """The estimate."""

    def predict(self, phi: Triple) -> float:
        """Return the predicted y."""
        a, b, c = self.parameters
        return a * phi[0] + b * phi[1] + c * phi[2]

    def update(self, phi: Triple, value: float) -> None:
        """Update with a sample; one that is not finite is ignored."""
        error = value - self.predict(phi)
        u01, u02, u12 = self._u
        d0, d1, d2 = self._d
        f1 = phi[1] + u01 * phi[0]
        f2 = phi[2] + u02 * phi[0] + u12 * phi[1]
        g0, g1, g2 = d0 * phi[0], d1 * f1, d2 * f2
        # From the noise's variance to that of the error, a parameter at a time.
        first = self._noise + phi[0] * g0
        second = first + f1 * g1
        third = second + f2 * g2
        if not math.isfinite(error * third):
            return
        slope = f2 / second
        gain0 = g0 + g1 * u01
        self._u = (u01 - f1 / first * g0, u02 - slope * gain0, u12 - slope * g1)
        self._d = (d0 * self._noise / first, d1 * first / second, d2 * second / third)
        a, b, c = self.parameters
        share = error / third
        self.parameters = (
            a + share * (gain0 + g2 * u02),
            b + share * (g1 + g2 * u12),
            c + share * g2,
        )
        self._forget()

    def variances(self) -> Triple:
        """Return the variance of each parameter."""
        u01, u02, u12 = self._u
        d0, d1, d2 = self._d
        return d0 + u01 * u01 * d1 + u02 * u02 * d2, d1 + u12 * u12 * d2, d2

    def _forget(self) -> None:
        most0, most1, most2 = self._initial
        d0, d1, d2 = self._d
        factor = 1.0 / self._forgetting
        self._d = (min(d0 * factor, most0), min(d1 * factor, most1), min(d2 * factor, most2))
        v0, v1, _ = self.variances()
        if v0 > LARGEST_RISE * most0 or v1 > LARGEST_RISE * most1:
            self._d, self._u = self._initial, (0.0, 0.0, 0.0)
