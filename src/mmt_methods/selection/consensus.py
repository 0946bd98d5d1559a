"""Prediction of each point's level and shape by all other points, in closed form.

A Gaussian process without one of its observations follows from the inverse of the covariance of
all (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, section 5.4.2): with
``a`` the weights ``inverse(C) y`` and ``c`` the diagonal of the inverse, the mean is ``y - a / c``
and the variance ``1 / c``. The prior is that of `mmt.texture.field.covariance`. Its setting and the
scatter of the observations are unknown, so the prediction is a mixture over all settings and over
several factors on the scatter, weighted by evidence.

Cost: O(s f e^3) for the evidence of s settings and f factors, of at most `EVIDENCE` observations,
and O(k n^3) for the k members of the mixture, mostly two or three.

The logarithm of a filter's spectrum is the sum of *level* and *shape*. The level is its mean over
frequency: up to a constant, the logarithm of the excitation's variance. Both are fields over speed,
force and heading, and each point is predicted from all others. The level has the prior of a
texture's level. The shape has the same prior at each frequency, except that the means of its slopes
are zero.

The scatter of fits is known for a texture that is stationary within the segment. For the logarithm
of the spectrum, the Fisher information of a stationary Gaussian signal does not depend on the
spectrum (Whittle 1953; Bloomfield 1973). With r the difference in log spectrum between an
autoregressive fit of order m to N samples and the truth, ``N / 2 mean(r^2)`` has a chi-squared
distribution of m + 1 degrees of freedom, one of them for the level. So the level has the variance
``2 / N``, and the shape ``2 m / N``, averaged over frequency. Other textures scatter more.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.texture.field.covariance import Coordinates, coordinates, prior_covariance, settings
from mmt.texture.field.posterior import SETTINGS
from mmt.texture.linear_algebra import cholesky, solve_backward, solve_forward
from mmt_methods.selection.points import ModelPoints, log_density_of

EVIDENCE: Final = 64
"""Largest number of present observations, evenly chosen, from which settings are weighted. Using
all of some 120 finds as many knocks, at twice the cost."""

_NEGLIGIBLE: Final = 0.1
"""Share of the largest weight below which a member is left out; 0.01 finds as many knocks."""


class LeaveOneOutPrediction(NamedTuple):
    """Prediction of each of n observations by the others.

    ``mean`` (n, c), in the values' unit; ``variance`` (n,) of an observation about it, scatter
    included; ``scatter`` (n,), the scatter's part of the variance.
    """

    mean: FloatArray
    variance: FloatArray
    scatter: FloatArray


class LeaveOneOut:
    """Predictor of observations at n strokes from those that are present.

    Parameters
    ----------
    points
        Normalised, shape (n, 2) or (n, 3).
    scatter
        Variance of each observation about the field, up to a factor; shape (n,), positive.
    factors
        Candidates for that factor.
    """

    def __init__(self, points: FloatArray, scatter: FloatArray, factors: Sequence[float]) -> None:
        self._at = coordinates(points)
        self._scatter, self._factors = scatter, factors
        self._settings = settings(SETTINGS, directed=points.shape[1] > 2, rough=False)
        self._priors: dict[int, FloatArray] = {}

    def predict(
        self, groups: Sequence[FloatArray], effective: Sequence[float], present: BoolArray
    ) -> list[LeaveOneOutPrediction]:
        """Predict every observation, present or not, from the present others.

        Parameters
        ----------
        groups
            Values, each (n, c), with a prior mean that is constant; all c channels of a group
            share one mixture.
        effective
            How many independent channels each group is worth.
        present
            Shape (n,), at least two.
        """
        known = np.flatnonzero(present)
        weights = self._weights(groups, effective, known)
        inverses: dict[tuple[int, int], FloatArray] = {}
        for setting, factor in np.argwhere((weights > 0.0).any(axis=0)).tolist():
            own = np.diag(self._factors[factor] * self._scatter[known])
            root = cholesky(self._prior(setting)[np.ix_(known, known)] + own)
            white = solve_forward(root, np.eye(len(root)))
            inverses[setting, factor] = solve_backward(root, white)
        return [
            self._mixed(values, weight, inverses, present)
            for values, weight in zip(groups, weights, strict=True)
        ]

    def _prior(self, setting: int) -> FloatArray:
        if setting not in self._priors:
            row = self._settings[setting]
            self._priors[setting] = prior_covariance(self._at, self._at, row)
        return self._priors[setting]

    def _weights(
        self, groups: Sequence[FloatArray], effective: Sequence[float], known: IntArray
    ) -> FloatArray:
        """Return the weight of each setting and factor for each group, (groups, s, f)."""
        places = np.linspace(0, len(known) - 1, min(len(known), EVIDENCE)).round().astype(int)
        chosen = known[places]
        at = Coordinates(*(axis[chosen] for axis in self._at))
        rests = [values[chosen] - values[known].mean(axis=0) for values in groups]
        evidence = np.zeros((len(groups), len(self._settings), len(self._factors)))
        for row, prior in enumerate(prior_covariance(at, at, self._settings)):
            for column, factor in enumerate(self._factors):
                root = cholesky(prior + np.diag(factor * self._scatter[chosen]))
                logarithm = np.log(np.diagonal(root)).sum()
                for group, (rest, count) in enumerate(zip(rests, effective, strict=True)):
                    squares = np.square(solve_forward(root, rest.T)).sum() / rest.shape[1]
                    evidence[group, row, column] = -count * (0.5 * squares + logarithm)
        weights = np.exp(evidence - evidence.max(axis=(1, 2), keepdims=True))
        weights[weights < _NEGLIGIBLE] = 0.0
        return np.asarray(weights / weights.sum(axis=(1, 2), keepdims=True))

    def _mixed(
        self,
        values: FloatArray,
        weights: FloatArray,
        inverses: dict[tuple[int, int], FloatArray],
        present: BoolArray,
    ) -> LeaveOneOutPrediction:
        known, absent = np.flatnonzero(present), np.flatnonzero(~present)
        middle = values[known].mean(axis=0)
        rest = values[known] - middle
        means, variances, shares = [], [], []
        scatter = np.zeros(len(values))
        for (setting, factor), inverse in inverses.items():
            weight = float(weights[setting, factor])
            if weight == 0.0:
                continue
            own = self._factors[factor] * self._scatter
            gains, diagonal = inverse @ rest, np.diagonal(inverse)
            mean, variance = np.empty(values.shape), np.empty(len(values))
            mean[known], variance[known] = rest - gains / diagonal[:, None], 1.0 / diagonal
            if len(absent):
                prior = self._prior(setting)
                across = prior[np.ix_(absent, known)]
                mean[absent] = across @ gains
                explained = np.einsum("ij,ij->i", across @ inverse, across)
                variance[absent] = np.diagonal(prior)[absent] + own[absent] - explained
            means.append(mean)
            variances.append(np.maximum(variance, own))
            shares.append(weight)
            scatter += weight * own
        mean = np.einsum("s,snc->nc", shares, means)
        variance = np.einsum("s,sn->n", shares, variances)
        for weight, each in zip(shares, means, strict=True):
            variance += weight * np.square(each - mean).mean(axis=1)
        return LeaveOneOutPrediction(mean + middle, variance, scatter)


_STEPS: Final = np.arange(5) / 2.0
"""Exponents e of factors m^e by which the level's scatter ``2 / N`` is multiplied: 0 gives that of
a stationary texture's level, 1 that of its shape, and 2 another m times that."""


class Consensus:
    """Predictor of the spectra of a model's points from each other.

    Parameters
    ----------
    data
        The points.

    Attributes
    ----------
    level, shape
        Level and shape of each point's own filter, (n, 1) and (n, f), nepers of power.
    """

    def __init__(self, data: ModelPoints) -> None:
        logarithm = log_density_of(data.lsf, data.variance, data.frequencies)
        self.level = logarithm.mean(axis=1, keepdims=True)
        self.shape = logarithm - self.level
        self._law = coordinates(data.points).law[:, None]
        self._order = data.lsf.shape[1]
        factors = np.power(float(self._order), _STEPS)
        self._others = LeaveOneOut(data.points, 2.0 / data.samples(), np.unique(factors).tolist())

    def predict_from(self, present: BoolArray) -> list[LeaveOneOutPrediction]:
        """Predict level (n, 1) and shape (n, f) from the others in the mask `present`, two or more.

        Notes
        -----
        O(n^3), see `LeaveOneOut`.
        """
        groups, effective = (self.level - self._law, self.shape), (1.0, float(self._order))
        level, shape = self._others.predict(groups, effective, present)
        return [level._replace(mean=level.mean + self._law), shape]

    def smoothed(self) -> FloatArray:
        """Return log spectra (n, f) that combine each point's own with its prediction."""
        total, everyone = np.zeros_like(self.shape), np.ones(len(self.shape), np.bool_)
        agreed = self.predict_from(everyone)
        for own, others in zip((self.level, self.shape), agreed, strict=True):
            share = (others.scatter / others.variance)[:, None]  # weight of the prediction
            total += share * others.mean + (1.0 - share) * own
        return np.asarray(total)
