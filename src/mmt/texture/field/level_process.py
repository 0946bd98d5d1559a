"""The level of a texture over speed, force and heading, with its uncertainty.

A model's segments tell their power with sampling noise that is known from their effective length
(`mmt.texture.autoregression.effective_sample_size`), and power is smooth in the logarithms of speed
and force. So the level is estimated as a Gaussian process whose noise differs from sample to sample
(Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.2 and 5.4; the
prior is in `mmt.texture.field.level_covariance`).

Assumptions: within a segment the vibration is stationary and Gaussian; segments are independent;
the level's logarithm has the prior's smoothness. What speed and force vary within a segment, and
what else scatters, is taken up by one factor on the noise, which the samples choose.

Hyperparameters are those of the largest posterior, by a bounded quasi-Newton search with exact
slopes over at most `LARGEST_CHOICE` samples, and chosen anew when the samples have grown by a
quarter. In between an update costs one Cholesky factorisation, O(n^3 / 3) for n samples, at most
`LARGEST`: more are pooled first.
"""

from typing import Final

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.autoregression.effective_sample_size import LEAST, UNKNOWN, log_power_scatter
from mmt.texture.field.level_covariance import (
    NOISE,
    PLANAR,
    PRIOR,
    Departures,
    Features,
    covariance,
    covariance_on_grid,
    departure_variance,
    departures,
    features,
    law_variance,
    mean_on_grid,
    nodes,
)
from mmt.texture.field.level_hyperparameters import (
    BOUND,
    LevelSamples,
    add_noise,
    choose_hyperparameters,
    pooled,
)
from mmt.texture.field.level_table import table_grid
from mmt.texture.model.samples import TextureSamples

_LARGEST_SHARED: Final = 200
"""Number of evenly chosen segments that `shared_effective` averages over: its cost stays O(n)."""

_SPEED_WIDTH: Final = 0.5  # nepers
_LINE_WIDTH: Final = 0.3  # sine of the angle between two lines


def shared_effective(points: FloatArray, lengths: FloatArray, effective: FloatArray) -> FloatArray:
    """Return effective sample sizes that are averaged over segments of similar strokes, shape (n,).

    A segment's effective sample size follows from the spectrum that is fitted to it, and scatters
    with that fit: the powers of short segments whose narrow lines look broad would be trusted too
    much. The share of independent samples is a property of the texture at that stroke, so it is
    averaged over segments of similar speed along a similar line (a stroke and its return count as
    alike), weighted by their length. Force, which hardly moves lines, does not count.

    Parameters
    ----------
    points
        Normalised inputs of the segments, shape (n, 2) or (n, 3).
    lengths
        Number of samples of each, shape (n,).
    effective
        Result of `effective_sample_size.effective_samples` for each alone, shape (n,).
    """
    count = len(effective)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _LARGEST_SHARED)).round().astype(int))
    at = features(points)
    apart = np.square(np.subtract.outer(at.speed, at.speed[chosen]) / _SPEED_WIDTH)
    if points.shape[1] == 3:
        turn = np.sin(np.subtract.outer(at.heading, at.heading[chosen]))
        apart += np.square(turn / _LINE_WIDTH)
    apart -= apart.min(axis=1, keepdims=True)  # so that one of them counts, however far
    weights = np.exp(-0.5 * apart) * lengths[chosen]
    dependent = weights @ (lengths / effective)[chosen] / weights.sum(axis=1)
    return np.asarray(np.maximum(lengths / dependent, LEAST))


DB: Final = 10.0 / np.log(10.0)
"""Decibel in a neper of power."""

LARGEST: Final = 200
"""Samples of the process; where there are more, those that lie closest are pooled."""

_GROWTH: Final = 1.25
_LEAST_EXPONENT: Final = 0.2
_RISE: Final = 6.0  # nepers above the loudest sample, at most
_LEAST: Final = -690.0  # nepers, above what underflows
_LEAST_SHARE: Final = 0.1  # of a power that is the texture's, however much is noise


class LevelProcess:
    """The posterior of the level's logarithm; immutable.

    Parameters
    ----------
    points
        Normalised inputs of the samples, shape (n, 2) or (n, 3), finite.
    power
        Mean square of each, shape (n,); samples of zero power are ignored, at least one is
        above zero.
    effective
        Effective sample size of each power, shape (n,), positive.
    noise_power
        Noise power of the sensor, which is subtracted from every power.
    previous
        An earlier state, whose hyperparameters are kept until there is much more to learn.
    hyperparameters
        Their logarithms, shape (4,) or (10,), where they are known: none are then chosen.

    Raises
    ------
    InputError
        Hyperparameters are of another shape or not finite.
    """

    def __init__(
        self,
        points: FloatArray,
        power: FloatArray,
        effective: FloatArray,
        *,
        noise_power: float = 0.0,
        previous: "LevelProcess | None" = None,
        hyperparameters: FloatArray | None = None,
    ) -> None:
        known = power > 0.0
        self.directed = points.shape[1] == 3
        bias, variance = log_power_scatter(effective[known])
        share = np.maximum(1.0 - noise_power / power[known], _LEAST_SHARE)
        logarithm = np.log(power[known]) + np.log(share) - bias
        variance = variance / share**2  # of ln(power - noise), to first order
        self._loudest = float(logarithm.max())
        self._variance = variance
        every = LevelSamples(features(points[known]), logarithm, variance)
        self._samples = every = pooled(every, LARGEST)
        self._middle = float(np.mean(every.logarithm - every.at.law))
        residuals = every.logarithm - every.at.law - self._middle
        self.chosen_at = int(known.sum())
        if hyperparameters is not None:
            self.hyperparameters = _checked(hyperparameters, directed=self.directed)
        elif previous is not None and not self._outgrown(previous):
            self.hyperparameters, self.chosen_at = previous.hyperparameters, previous.chosen_at
        else:
            start = None if previous is None else previous.hyperparameters
            self.hyperparameters = choose_hyperparameters(
                every, residuals, start, directed=self.directed
            )
        between = departures(every.at, every.at, directed=self.directed)
        self._factor = _factor(between, every.variance, self.hyperparameters)
        self._weights = cho_solve((self._factor, True), residuals, check_finite=False)

    def level_db(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation of the level, each shape (k,), in dB.

        They describe the level itself, not what a further sample would measure; 0 dB is 1
        (m/s2)^2.

        Parameters
        ----------
        points
            Normalised, shape (k, 2) or (k, 3), speed and force above zero; below `SLOWEST` they
            count as that.
        """
        at = features(points)
        between = departures(at, self._samples.at, directed=self.directed)
        prior = covariance(between, self.hyperparameters)
        mean = prior @ self._weights + self._middle + at.law
        explained = solve_triangular(
            self._factor, prior.T, lower=True, check_finite=False, overwrite_b=True
        )
        variance = law_variance(at) + departure_variance(self.hyperparameters)
        variance -= np.einsum("ij,ij->j", explained, explained)
        return DB * mean, DB * np.sqrt(np.maximum(variance, 0.0))

    def covariance_on_grid(self, axes: Features) -> FloatArray:
        """Return the posterior covariance of the level among a grid's nodes, (g, g), nepers^2.

        Parameters
        ----------
        axes
            Logarithms of speeds and forces, and headings (one in the plane), each of a shape of
            its own; the nodes are in the order of `level_covariance.nodes`.
        """
        h = self.hyperparameters
        prior = covariance_on_grid(axes, self._samples.at, h)
        explained = solve_triangular(
            self._factor, prior.T, lower=True, check_finite=False, overwrite_b=True
        )
        posterior = covariance_on_grid(axes, nodes(axes), h) - explained.T @ explained
        return np.asarray(posterior)

    @property
    def segment_variance(self) -> float:
        """What a further segment's power would scatter by, nepers^2: as the median one's does."""
        noise = np.exp(2.0 * self.hyperparameters[NOISE]) * self._variance
        return float(np.median(noise))

    def table(self) -> FloatArray:
        """Return the mean, in nepers, on the grid of `mmt.texture.field.level_table`.

        Shape (headings, speeds, forces). Below the slowest and the lightest sample it falls
        towards zero at least as speed^0.2 and force^0.2, whatever the samples say.
        """
        grid, at = table_grid(directed=self.directed), self._samples.at
        total = mean_on_grid(grid, at, self._weights, self.hyperparameters)
        law = Features(grid.speed[:, None], grid.force[None, :], grid.heading).law
        total += self._middle + law
        _fall(np.moveaxis(total, 1, 0), grid.speed, float(at.speed.min()))
        _fall(np.moveaxis(total, 2, 0), grid.force, float(at.force.min()))
        return np.clip(total, _LEAST, self._loudest + _RISE)

    def _outgrown(self, previous: "LevelProcess") -> bool:
        """Say whether hyperparameters of an earlier state are to be chosen anew."""
        if previous.directed != self.directed:
            return True
        return not self.chosen_at < _GROWTH * previous.chosen_at


def level_process(
    samples: TextureSamples,
    previous: LevelProcess | None = None,
    hyperparameters: FloatArray | None = None,
) -> LevelProcess | None:
    """Return the process of a model's samples, None where none has any power.

    A sample whose length is not known counts as `UNKNOWN`. The others are as in `LevelProcess`.
    """
    if not (samples.power > 0.0).any():
        return None
    effective = samples.effective
    if effective is not None and samples.lengths is not None:
        effective = shared_effective(samples.points, samples.lengths, effective)
    return LevelProcess(
        samples.points,
        samples.power,
        np.full(len(samples), UNKNOWN) if effective is None else effective,
        noise_power=samples.noise_power,
        previous=previous,
        hyperparameters=hyperparameters,
    )


def _checked(hyperparameters: FloatArray, *, directed: bool) -> FloatArray:
    """Return hyperparameters brought into their bounds."""
    middle, spread = PRIOR[: len(PRIOR) if directed else PLANAR].T
    values = np.asarray(hyperparameters, dtype=np.float64)
    if values.shape != middle.shape or not np.isfinite(values).all():
        raise InputError(
            f"hyperparameters have shape {values.shape}: {middle.shape} and finite numbers needed"
        )
    return np.clip(values, middle - BOUND * spread, middle + BOUND * spread)


def _fall(levels: FloatArray, axis: FloatArray, lowest: float) -> None:
    """Let levels (nodes, ...) fall below the lowest sample of an axis, towards its zero."""
    first = int(np.searchsorted(axis, lowest))
    step = _LEAST_EXPONENT * (axis[1] - axis[0])
    for node in range(min(first, len(axis) - 1) - 1, -1, -1):
        np.minimum(levels[node], levels[node + 1] - step, out=levels[node])


def _factor(between: Departures, variance: FloatArray, logarithms: FloatArray) -> FloatArray:
    """Return the lower Cholesky factor of the samples' covariance, noise included."""
    total = covariance(between, logarithms)
    add_noise(total, variance, logarithms)
    return np.asarray(cholesky(total, lower=True, overwrite_a=True, check_finite=False))
