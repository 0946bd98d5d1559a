"""Prediction of each point's spectrum by the other points: level and shape, with their error.

The logarithm of a filter's spectrum is the sum of *level* and *shape*. The level is its mean over
frequency: up to a constant, the logarithm of the excitation's variance. Both are fields over speed,
force and heading, and each point is predicted from all others
(`mmt.texture.field.cross_validation`). The level has the prior of a texture's level. The shape has
the same prior at each frequency, except that the means of its slopes are zero.

The scatter of fits is known for a texture that is stationary within the segment. For the logarithm
of the spectrum, the Fisher information of a stationary Gaussian signal does not depend on the
spectrum (Whittle 1953; Bloomfield 1973). With r the difference in log spectrum between an
autoregressive fit of order m to N samples and the truth, ``N / 2 mean(r^2)`` has a chi-squared
distribution of m + 1 degrees of freedom, one of them for the level. So the level has the variance
``2 / N``, and the shape ``2 m / N``, averaged over frequency. Other textures scatter more.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.texture.field.covariance import coordinates
from mmt.texture.field.cross_validation import LeaveOneOut, LeaveOneOutPrediction
from mmt_methods.selection.points import ModelPoints, log_density_of

_STEPS: Final = np.arange(5) / 2.0
"""Exponents e of factors m^e by which the level's scatter ``2 / N`` is multiplied: 0 gives that of
a stationary texture's level, 1 that of its shape, and 2 another m times that."""


class ConsensusPrediction(NamedTuple):
    """Level (n, 1) and shape (n, f) of n points as the others predict them."""

    level: LeaveOneOutPrediction
    shape: LeaveOneOutPrediction

    @property
    def logarithm(self) -> FloatArray:
        """The logarithm of the spectra, (n, f)."""
        return np.asarray(self.level.mean + self.shape.mean)


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

    def predict_from(self, present: BoolArray) -> ConsensusPrediction:
        """Predict every point from the other points in the mask `present`, at least two.

        Notes
        -----
        O(n^3), see `mmt.texture.field.cross_validation`.
        """
        groups, effective = (self.level - self._law, self.shape), (1.0, float(self._order))
        level, shape = self._others.predict(groups, effective, present)
        return ConsensusPrediction(level._replace(mean=level.mean + self._law), shape)

    def smoothed(self, agreed: ConsensusPrediction) -> FloatArray:
        """Return log spectra (n, f) that combine each point's own with its prediction."""
        total = np.zeros_like(self.shape)
        for own, others in zip((self.level, self.shape), agreed, strict=True):
            share = (others.scatter / others.variance)[:, None]  # weight of the prediction
            total += share * others.mean + (1.0 - share) * own
        return np.asarray(total)
