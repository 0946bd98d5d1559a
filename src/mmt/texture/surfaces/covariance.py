"""Prior covariances of surfaces between blocks, for many settings of the prior at once.

Arrays are (k, n, m) for k settings, n blocks and m others. The likelihood of an unknown surface is
needed under every setting with each new block; one array for all takes a fraction of the time.
"""

from collections.abc import Sequence
from copy import copy
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.texture.surfaces.prior import REVERSAL, Prior, Setting

_ALONG: Final = -0.5 / 2.0**2
"""A grain that is not crossed varies with the speed along it over a length of 2, in logarithms."""

_CONTRAST: Final = 0.5
"""How differently the law of a crossed grain may follow both speeds, as a share of its slope."""


class SettingInputs:
    """Inputs of n blocks, (n, 2) or (n, 4), transformed for each of k settings.

    ``across`` and ``along`` (k, n): logarithms of the effective speeds across and along a grain;
    without a grain that of the speed. ``law`` (k, n): the one that the power law uses.
    """

    def __init__(self, inputs: FloatArray, settings: RecordArray) -> None:
        self.inputs = inputs
        self.settings = settings
        speed = inputs[:, 0]
        if inputs.shape[1] == 2:
            self.across = np.broadcast_to(speed, (len(settings), len(speed)))
            self.along = self.law = self.across
            return
        heading, angle = settings["across"][:, None], settings["crossed"][:, None]
        share = np.square(settings["along"])[:, None]
        other = heading + np.where(angle > 0.0, angle, 0.5 * np.pi)
        x, y = inputs[:, 2], inputs[:, 3]
        length = np.maximum(x * x + y * y, np.finfo(np.float64).tiny)  # to and fro has none
        there = np.square(np.cos(heading) * x + np.sin(heading) * y) / length
        aside = np.square(np.cos(other) * x + np.sin(other) * y) / length
        self.across = speed + 0.5 * np.log(there + share * (1.0 - there))
        self.along = speed + 0.5 * np.log(aside + share * (1.0 - aside))
        self.law = np.where(angle > 0.0, 0.5 * (self.across + self.along), self.across)

    def under(self, numbers: Sequence[int]) -> "SettingInputs":
        """Return the inputs under some of the settings."""
        if len(numbers) == len(self.settings):
            return self
        found, chosen = copy(self), list(numbers)
        found.settings, found.law = self.settings[chosen], self.law[chosen]
        found.across, found.along = self.across[chosen], self.along[chosen]
        return found

    def mean(self, prior: Prior) -> FloatArray:
        """Return a component's prior mean, shape (k, n), or (1, n) where settings agree."""
        constant, per_speed, per_force = prior.mean
        speed = self.law if per_speed else self.law[:1]
        mean: FloatArray = constant + per_speed * speed + per_force * self.inputs[:, 1]
        return np.asarray(np.sqrt(prior.scale) * mean, dtype=np.float64)


class Covariances:
    """Common factors of the covariances between n blocks and m others under k settings."""

    def __init__(self, one: SettingInputs, other: SettingInputs) -> None:
        self._of = {name: one.settings[name][:, None, None] for name in Setting._fields}
        self._crossed = self._of["crossed"] > 0.0
        self._forces = np.outer(one.inputs[:, 1], other.inputs[:, 1])
        self._law = one.law[:, :, None] * other.law[:, None, :]
        self._residual = self._residuals(one, other)
        self._heading: FloatArray | None = None
        if one.inputs.shape[1] == 4:
            self._follow_heading(one, other)

    def of(self, prior: Prior) -> FloatArray:
        """Return the prior covariance of a component, shape (k, n, m)."""
        total: FloatArray = prior.roughness**2 * self._residual
        if self._heading is not None:
            total += prior.per_heading**2 * self._heading
        total += prior.per_speed**2 * self._law
        total += prior.per_force**2 * self._forces + prior.constant**2
        total *= prior.scale
        return total

    def _residuals(self, one: SettingInputs, other: SettingInputs) -> FloatArray:
        """Return the covariance of smooth residuals and of spectral lines."""
        of, crossed = self._of, self._crossed
        smooth = -0.5 / np.square(of["length"])
        both = smooth * np.square(one.inputs[:, 1, None] - other.inputs[None, :, 1])
        across = _apart(one.across, other.across)
        grain = of["along"] < 1.0
        if grain.any():
            along = _apart(one.along, other.along)
            both = both + np.where(grain & ~crossed, _ALONG, 0.0) * along
            across += crossed * along
        total: FloatArray = np.square(of["residual"]) * np.exp(smooth * across + both)
        ridged = np.flatnonzero(one.settings["lines"] > 0.0)
        if len(ridged):
            moved = _apart(np.exp(one.across[ridged]), np.exp(other.across[ridged]))
            if crossed[ridged].any():
                along = _apart(np.exp(one.along[ridged]), np.exp(other.along[ridged]))
                moved += crossed[ridged] * along
            exponent = -0.5 / np.square(of["period"][ridged]) * moved + both[ridged]
            total[ridged] += np.square(of["lines"][ridged]) * np.exp(exponent)
        return total

    def _follow_heading(self, one: SettingInputs, other: SettingInputs) -> None:
        """Add the dependence of the residual, and of a separate term, on the heading."""
        of = self._of
        cosine = one.inputs[:, 2:] @ other.inputs[:, 2:].T
        heading = np.square(of["nap"]) * cosine
        turning = np.flatnonzero(np.isfinite(one.settings["turn"]))
        if len(turning):
            twice = 4.0 * (1.0 - np.square(cosine))
            alike = np.exp(-0.5 / np.square(of["turn"][turning]) * twice)
            alike *= np.exp((cosine - 1.0) / REVERSAL**2)
            self._residual[turning] *= np.where(of["along"][turning] < 1.0, 1.0, alike)
            heading[turning] += np.square(of["turning"][turning]) * alike
        self._heading = heading
        if self._crossed.any():
            contrast = self._crossed * (one.across - one.along)[:, :, None]
            self._law += _CONTRAST**2 * contrast * (other.across - other.along)[:, None, :]


def _apart(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the squared differences of (k, n) and (k, m), shape (k, n, m)."""
    return np.square(one[:, :, None] - other[:, None, :])
