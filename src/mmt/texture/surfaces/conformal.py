"""A sequential test whose mean time between false alarms is at least what is asked for.

Each innovation is bet on against earlier ones of the same surface. Where nothing has changed it is
exchangeable with them, and the ratio of any function's value there to its mean over all has an
expected value of 1, whatever their distribution (Vovk, Gammerman and Shafer, Algorithmic Learning
in a Random World, 2005; Vovk, "Conformal e-prediction", 2024). Nobody can win on such bets in the
mean; and the Shiryaev-Roberts statistic, the sum over all possible change-points of the product of
the bets since then, grows by 1 per observation in the mean. Until it exceeds A there are A
observations at least, in the mean (Pollak, Annals of Statistics 13, 1985; Shin, Ramdas and Rinaldo,
"E-detectors", 2022). Nothing is assumed of the scatter but that it is exchangeable.

The function is a likelihood ratio, so that the bets win soon if there was a change.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.surfaces.prior import NU

LARGEST: Final = 500
"""Number of earlier innovations kept, the newest ones."""

LARGEST_WIN: Final = 0.8
"""Share of the threshold that one run of observations may win: less than the whole, so that two are
needed, and more than half, so that two suffice. Chosen on the development half of HaTT's models
among 0.65 to 0.8: higher is sooner, and finds more where there is nothing."""

_FIRST: Final = 50
_FIRST_TAIL: Final = 5.0
"""Before there are any innovations: so many, of Student's distribution with these degrees."""

_RUNS: Final = (0, 1, 3, 8, 24)
"""Numbers of newest innovations that may share a shift."""

_SHIFTS: Final = (1.0, 10.0)
"""Variances of the shift, in those of an innovation."""

_LONGEST: Final = 8.0
"""Length beyond which an innovation counts as no longer, in suggesting a shift: a knock."""


class ConformalBets:
    """Bets against the hypothesis that an innovation is like earlier ones of this surface.

    An innovation is bet on by the likelihood ratio of a shift, whose size and direction are those
    that the newest innovations suggest if they have one in common, over the sum of the same
    ratio for every earlier innovation.

    Parameters
    ----------
    components
        Components of an innovation.
    """

    def __init__(self, components: int) -> None:
        random = np.random.default_rng(0)
        normal = random.standard_normal((_FIRST, components))
        chi = random.chisquare(_FIRST_TAIL, (_FIRST, 1)) / _FIRST_TAIL
        self._earlier: FloatArray = normal / np.sqrt(chi)

    def add(self, innovations: FloatArray) -> None:
        """Add innovations (n, components) after which nothing had changed."""
        self._earlier = np.concatenate([self._earlier, innovations])[-LARGEST:]

    def log_bet(self, newest: FloatArray, whitening: FloatArray) -> float:
        """Return the natural logarithm of the bet on the last of the newest innovations.

        Parameters
        ----------
        newest
            Innovations since the last that was added, oldest first, (m, components).
        whitening
            Matrix that makes the components uncorrelated.
        """
        recent = newest[-1 - _RUNS[-1] :] @ whitening.T
        ratios = log_shift_ratios(
            np.vstack([self._earlier @ whitening.T, recent[-1:]]), recent[:-1]
        )
        total = np.logaddexp.reduce(ratios)
        return float(ratios[-1] - total + np.log(len(ratios)))


def log_shift_ratios(values: FloatArray, recent: FloatArray) -> FloatArray:
    """Return log likelihood ratios (n,) of a shift for n values, given the m before them.

    A mixture over how many of the newest share the shift and over its size, each weighted by how
    well it predicted them.
    """
    size = values.shape[1]
    length = np.sqrt(np.square(recent).sum(axis=1, keepdims=True))
    tame = recent / np.maximum(length / _LONGEST, 1.0)
    sums = np.vstack([np.zeros((1, size)), np.cumsum(tame[::-1], axis=0)])
    runs = np.array([run for run in _RUNS if run <= len(recent)])
    run, prior = (grid.ravel() for grid in np.meshgrid(runs, _SHIFTS, indexing="ij"))
    spread = 1.0 / (run + 1.0 / prior)
    total = sums[run]
    weights = 0.5 * spread * np.square(total).sum(axis=1) - 0.5 * size * np.log1p(run * prior)
    means = spread[:, None] * total
    squares = np.square(values).sum(axis=1)
    apart = squares[:, None] - 2.0 * values @ means.T + np.square(means).sum(axis=1)
    there = np.log1p(apart / (NU * (1.0 + spread))) + size / (NU + size) * np.log1p(spread)
    stayed = np.log1p(squares / NU)
    ratios = -0.5 * (NU + size) * (there - stayed[:, None])
    return np.asarray(np.logaddexp.reduce(weights - np.logaddexp.reduce(weights) + ratios, axis=1))


class ShiryaevRoberts:
    """The logarithm of the Shiryaev-Roberts statistic, observation by observation.

    Observations come in runs that may be strange together: the bets of one run, from any of its
    observations on, win `LARGEST_WIN` of the threshold at most. A bet that is cut has a mean below
    1, so that the bound holds.

    Parameters
    ----------
    log_threshold
        Logarithm of the mean weight of observations until a false alarm, at least.
    """

    def __init__(self, log_threshold: float) -> None:
        self._log_threshold = log_threshold
        self._won = 0.0
        self.log_statistic = -np.inf

    def update(self, log_bet: float, weight: float = 1.0, *, new_run: bool = True) -> bool:
        """Add an observation before which a change may have come; return whether that is found.

        ``weight`` says how much likelier a change is just there.
        """
        won = 0.0 if new_run else self._won
        log_bet = min(log_bet, LARGEST_WIN * self._log_threshold - won)
        self._won = max(won + log_bet, 0.0)
        self.log_statistic = float(np.logaddexp(self.log_statistic, np.log(weight))) + log_bet
        return self.log_statistic > self._log_threshold

    def reset(self) -> None:
        """Begin anew."""
        self.log_statistic = -np.inf
