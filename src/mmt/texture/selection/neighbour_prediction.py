"""Prediction of a point's spectrum from its neighbours: kriging of log spectra.

Level and shape of a texture change smoothly with speed, force and heading, and close to
proportionally. So the logarithm of the spectrum, over the logarithms of speed and force, is
modelled as a plane with a smooth departure: a Gaussian process with a Matern covariance of
smoothness 5/2, predicted from the nearest neighbours (ordinary kriging; Rasmussen and Williams,
Gaussian Processes for Machine Learning, 2006, sections 2.2 and 2.7). It averages as many fits as
the smoothness of the texture allows, and extrapolates a little, so that corners of the hull can be
tested. Over velocity a stroke and its return count as nearly alike, since ridges are the same from
both sides.

The scatter of a fit is known. In the logarithm of the spectrum the Fisher information of a
stationary Gaussian signal does not depend on its spectrum (Whittle 1953; Bloomfield 1973): with r
the difference of the logarithms of an autoregressive fit of order m to N samples and of the truth,
``N / 2 mean(r^2)`` has a chi-squared distribution of m + 1 degrees of freedom. So a mean of squares
of logarithms over a uniform grid is the whitened distance, without a matrix, and its mean is ``2 (m
+ 1) / N``.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky
from scipy.spatial import cKDTree

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.texture.selection.kriging_kernels import covariance, kriged, nearest

_NEIGHBOURS: Final = {1: 16, 2: 24}
_MOST_NEIGHBOURS: Final = 32
_KNEE: Final = 0.05  # of normalised speed and force, below which the logarithm becomes linear
_SLOPE: Final = 1.2  # of the plane, in nepers for one of the logarithm
_FORCE_LENGTH: Final = 5.0
_RETURN: Final = 0.9
_CHOICE: Final = 128
_JITTER: Final = 1e-9

SMOOTHNESS: Final = ((0.35, 1.5), (0.7, 0.85), (0.75, 0.26))
"""Departure in nepers, and its length along the logarithm of velocity: of a surface with
resonances, with some that follow the speed, and with lines. Between what the 17 textures of
`mmt.testing.simulation` have by themselves."""


class NeighbourPrediction(NamedTuple):
    """Linear predictions at every point from others: ``weights`` of ``members``, (n, k)."""

    members: IntArray
    weights: FloatArray

    def of(self, values: FloatArray) -> FloatArray:
        """Return the prediction of values (n, ...) at every point."""
        shape = (-1,) + (1,) * (values.ndim - 1)
        result = np.zeros_like(values)
        for weights, members in zip(self.weights.T, self.members.T, strict=True):
            result += weights.reshape(shape) * values[members]
        return result

    def scatter(self, variances: FloatArray) -> FloatArray:
        """Return the variance (n,) of value minus prediction, from the variance of each value."""
        result: FloatArray = variances + np.einsum(
            "nk,nk->n", self.weights**2, variances[self.members]
        )
        return result


class NeighbourPredictor:
    """Predictor of every point of a model from its neighbours.

    Parameters
    ----------
    points
        Shape (n, d): the last input is the force, the others the speed or the velocity.
    variances
        Variance of the scatter of each fit, shape (n,), positive.
    logarithms
        Logarithms of the spectra, shape (n, f), from which the smoothness is chosen.
    few
        Use half as many neighbours: predictions scatter a little more, and change less often
        when points are added.
    """

    def __init__(
        self,
        points: FloatArray,
        variances: FloatArray,
        logarithms: FloatArray,
        *,
        few: bool = False,
    ) -> None:
        velocity = points[:, :-1]
        speed = np.sqrt((velocity**2).sum(axis=1))
        growth = np.log1p(speed / _KNEE)
        scale = np.divide(growth, speed, out=np.ones_like(speed), where=speed > 0.0)
        force = np.copysign(np.log1p(np.abs(points[:, -1]) / _KNEE), points[:, -1])
        self._velocity = np.ascontiguousarray(velocity * scale[:, None])
        self._law = np.ascontiguousarray(np.column_stack([growth, force]))
        self._variances = np.ascontiguousarray(variances + _JITTER)
        self._back = _RETURN if points.shape[1] > 2 else 0.0
        self._count = _NEIGHBOURS.get(points.shape[1], _MOST_NEIGHBOURS) // (1 + few)
        self._last: tuple[IntArray, FloatArray] | None = None
        costs = [self._cost(smoothness, logarithms) for smoothness in SMOOTHNESS]
        self.smoothness = int(np.argmin(costs))

    def predict_from(self, present: BoolArray) -> NeighbourPrediction:
        """Return predictions of every point, present or not, from the present others.

        Parameters
        ----------
        present
            Mask of the points to predict from, shape (n,); at least two.

        Notes
        -----
        O(n log n) for the neighbours, O(k^3) for every point whose neighbours are not those of
        the last call.
        """
        departure, length = SMOOTHNESS[self.smoothness]
        voices = np.flatnonzero(present)
        places = np.column_stack([self._velocity / length, self._law[:, 1] / _FORCE_LENGTH])
        known = places[voices]
        if self._back:
            mirror = np.append(np.full(places.shape[1] - 1, -1.0), 1.0)
            known = np.vstack([known, known * mirror])
        count = min(self._count, len(voices) - 1)
        asked = min((2 if self._back else 1) * (count + 1), len(known))
        order = cKDTree(known).query(places, k=np.arange(1, asked + 1))[1]
        members = nearest(np.ascontiguousarray(order, dtype=np.int64), voices, count)
        if self._last is None or self._last[0].shape != members.shape:
            weights, changed = np.zeros(members.shape), np.arange(len(members))
        else:
            changed = np.flatnonzero((members != self._last[0]).any(axis=1))
            weights = self._last[1].copy()
        scales = np.array([departure, length, _SLOPE, _FORCE_LENGTH, self._back])
        kriged(self._velocity, self._law, self._variances, members, changed, scales, weights)
        self._last = members, weights
        return NeighbourPrediction(members, weights)

    def _cost(self, smoothness: tuple[float, float], logarithms: FloatArray) -> float:
        """Return minus the log evidence for a smoothness, of at most `_CHOICE` points."""
        n = len(logarithms)
        chosen = np.unique(np.linspace(0, n - 1, min(n, _CHOICE)).round().astype(int))
        scales = np.array([*smoothness, _SLOPE, _FORCE_LENGTH, self._back])
        total = covariance(self._velocity[chosen], self._law[chosen], scales)
        total[np.diag_indices(len(chosen))] += self._variances[chosen]
        values = logarithms[chosen] - logarithms[chosen].mean(axis=0)
        factor = cholesky(total, lower=True, check_finite=False)
        squares = (values * cho_solve((factor, True), values, check_finite=False)).sum(axis=0)
        return float(0.5 * squares.mean() + np.log(np.diag(factor)).sum())
