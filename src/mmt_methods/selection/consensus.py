"""What the other points say of each: level and shape of its spectrum, with their error.

The logarithm of a filter's spectrum is the *level*, its mean over frequency, which is the logarithm
of the excitation's variance but for a constant, and the *shape*, what is left. Both are fields over
speed, force and heading, and each point is predicted from all others
(`mmt.texture.field.cross_validation`). The level has the prior of a texture's level, and so has the
shape at each frequency, but that the means of its slopes are zero.

How a fit scatters is known for a texture that is stationary within the segment. In the logarithm of
the spectrum the Fisher information of a stationary Gaussian signal does not depend on its spectrum
(Whittle 1953; Bloomfield 1973): with r the difference of the logarithms of an autoregressive fit of
order m to N samples and of the truth, ``N / 2 mean(r^2)`` has a chi-squared distribution of m + 1
degrees of freedom, one of them the level's. So the level scatters by ``2 / N``, and the shape, in
the mean over frequency, by ``2 m / N``. A texture that is not stationary scatters more.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.texture.field.covariance import coordinates
from mmt.texture.field.cross_validation import LeaveOneOut, LeftOut
from mmt_methods.selection.points import ModelPoints, log_density_of

_STEPS: Final = np.arange(5) / 2.0
"""Exponents of the order m that the level's scatter is multiplied by: from that of a stationary
texture's level, by way of that of its shape, m times as much, to another m times that."""


class Agreed(NamedTuple):
    """Level (n, 1) and shape (n, f) of n points as the others predict them."""

    level: LeftOut
    shape: LeftOut

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
        Of each point's own filter, (n, 1) and (n, f), nepers of power.
    """

    def __init__(self, data: ModelPoints) -> None:
        logarithm = log_density_of(data.lsf, data.variance, data.frequencies)
        self.level = logarithm.mean(axis=1, keepdims=True)
        self.shape = logarithm - self.level
        self._law = coordinates(data.points).law[:, None]
        self._order = data.lsf.shape[1]
        factors = np.power(float(self._order), _STEPS)
        self._others = LeaveOneOut(data.points, 2.0 / data.samples(), np.unique(factors).tolist())

    def predict_from(self, present: BoolArray) -> Agreed:
        """Return the prediction of every point from the present others, at least two.

        Notes
        -----
        O(n^3), see `mmt.texture.field.cross_validation`.
        """
        groups, effective = (self.level - self._law, self.shape), (1.0, float(self._order))
        level, shape = self._others.predict(groups, effective, present)
        return Agreed(level._replace(mean=level.mean + self._law), shape)

    def smoothed(self, agreed: Agreed) -> FloatArray:
        """Return the logarithms (n, f) of spectra from each point's own and the others' word."""
        total = np.zeros_like(self.shape)
        for own, others in zip((self.level, self.shape), agreed, strict=True):
            share = (others.scatter / others.variance)[:, None]  # of the others
            total += share * others.mean + (1.0 - share) * own
        return np.asarray(total)
