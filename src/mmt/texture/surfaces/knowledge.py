"""What is known of one surface, and how likely it makes what the tool hears now.

Blocks that stand close to each other in the plane are merged into *cells*, so that the cost does
not grow with time: n cells, `LARGEST` at most. The posterior of the Gaussian processes of
`mmt.texture.surfaces.prior` given the cells predicts any further blocks jointly: their level
and shape may be off together by what is not known of the surface, and each of them by the noise
of a block. How rough the surface is is not known either: the density is the mean over the
settings, each weighted by the evidence of the cells (Rasmussen and Williams, chapter 5). It is
exact for the model assumed, so that between two surfaces its ratio is a Bayes factor.

Cost: with n = 100 about 1 ms for each setting that is still possible after blocks were added,
mostly one or two, and as much to predict 25 blocks. Stability: covariances are positive
definite by the noise on their diagonal, `NOISE` over the number of blocks in a cell, against a
largest prior variance of about 50: a condition number below 1e6.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from mmt.arrays import FloatArray
from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.heard import HeardBlocks
from mmt.texture.surfaces.prior import (
    NOISE,
    PRIORS,
    SETTINGS,
    Distances,
    Prior,
    Setting,
    mean_of,
    turning,
)

LARGEST: Final = 250
"""Most cells of a surface; the one that was not touched for longest leaves for the next."""

SHARED: Final = 0.02
"""Of the weight of all settings, divided anew between them where a surface may go on otherwise."""

_CELL_WIDTH: Final = 0.2  # of the logarithms of speed and force
_SECTORS: Final = 12
_LARGEST_WEIGHT: Final = 30.0
_IMPOSSIBLE: Final = -12.0
_LOG_TWO_PI: Final = float(np.log(2.0 * np.pi))


@dataclass
class _Cell:
    inputs: FloatArray
    values: FloatArray
    weight: float = 1.0

    def merge(self, inputs: FloatArray, values: FloatArray) -> None:
        """Take a further block into the means; beyond a weight old ones fade."""
        share = 1.0 / (self.weight + 1.0)
        self.inputs = self.inputs + share * (inputs - self.inputs)
        self.values = self.values + share * (values - self.values)
        self.weight = min(self.weight + 1.0, _LARGEST_WEIGHT)


@dataclass(frozen=True, eq=False)
class _Posterior:
    """One kind of component given n cells: Cholesky factor (n, n), whitened rests (n, c)."""

    factor: FloatArray
    whitened: FloatArray

    @property
    def evidence(self) -> float:
        """Natural logarithm, but for a constant."""
        logarithms = float(np.log(np.diag(self.factor)).sum())
        return -0.5 * float(np.square(self.whitened).sum()) - len(self.whitened.T) * logarithms


class SurfaceKnowledge:
    """The blocks of one surface; without any it is the prior, a surface that nobody knows.

    Parameters
    ----------
    settings
        How rough it may be.
    """

    def __init__(self, settings: Sequence[Setting] = SETTINGS) -> None:
        self._settings = settings
        self._cells: dict[tuple[int, ...], _Cell] = {}
        self._places = np.empty((0, 2))
        self._weights = np.full(len(settings), -np.log(len(settings)))
        self._posteriors: list[dict[str, _Posterior] | None] = [None] * len(settings)
        self._judged = 0
        self._current = True
        self.blocks = 0
        """How many blocks were added."""

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self._cells)

    @property
    def headings(self) -> FloatArray:
        """Cosines and sines of the headings at which it was touched, shape (n, 2) or (n, 0)."""
        if not self._cells:
            return np.empty((0, 2))
        return np.array([cell.inputs[2:] for cell in self._cells.values()])

    def add(self, blocks: Sequence[SurfaceBlock]) -> None:
        """Learn that these blocks are of this surface."""
        for block in blocks:
            values = turning() @ block.log_power
            key = _key(block.inputs)
            cell = self._cells.pop(key, None)
            if cell is None:
                cell = _Cell(block.inputs, values)
                if len(self._cells) >= LARGEST:
                    del self._cells[next(iter(self._cells))]
            else:
                cell.merge(block.inputs, values)
            self._cells[key] = cell  # behind those that were touched before
            self.blocks += 1
        self._current = self._current and not blocks

    def log_likelihood(self, heard: HeardBlocks) -> FloatArray:
        """Return how likely the first block is, the first two, and so on, jointly.

        Natural logarithms of densities, shape (n,).
        """
        total: FloatArray = np.logaddexp.reduce(self._by_setting(heard), axis=0)
        return total

    def log_likelihood_after(self, heard: HeardBlocks) -> FloatArray:
        """Return how likely all blocks are, all but the first, and so on, given those before.

        Natural logarithms of densities, shape (n,). A share of the weight is divided anew between
        the settings at the moment in question (fixed share; Herbster and Warmuth, "Tracking the
        best expert", Machine Learning 32, 1998): what was smooth so far may be rough elsewhere.
        """
        each = self._by_setting(heard)
        so_far = np.concatenate([self._weights[self._possible(), None], each[:, :-1]], axis=1)
        weights = so_far - np.logaddexp.reduce(so_far, axis=0)
        weights = np.logaddexp(np.log1p(-SHARED) + weights, np.log(SHARED / len(each)))
        after: FloatArray = np.logaddexp.reduce(weights + each[:, -1:] - so_far, axis=0)
        return after

    def _by_setting(self, heard: HeardBlocks) -> FloatArray:
        """Return the weighted likelihoods (settings that are possible, n) of `log_likelihood`."""
        self._condition()
        across = Distances(self._places, heard.inputs) if self._cells else None
        possible = self._possible()
        each = np.empty((len(possible), len(heard.inputs)))
        for row, number in enumerate(possible):
            setting, posteriors = self._settings[number], self._posteriors[number]
            each[row] = self._weights[number]
            for kind, prior in PRIORS.items():
                rest, spread = heard.rests[kind], heard.covariance(kind, setting)
                if across is not None and posteriors is not None:
                    explained, known = _explain(across.covariance(prior, setting), posteriors[kind])
                    rest, spread = rest - explained, spread - known
                each[row] += _log_density(rest, spread)
        return each

    def spread(self, inputs: FloatArray) -> dict[str, FloatArray]:
        """Return how well each kind of component is known at inputs (n, d).

        Standard deviations (n,) in natural logarithms of the power in a band, without the noise
        of a block, under the likeliest setting.
        """
        self._condition()
        number = int(np.argmax(self._weights))
        setting, posteriors = self._settings[number], self._posteriors[number]
        found = {}
        for kind, prior in PRIORS.items():
            spread = Distances(inputs, inputs).covariance(prior, setting)
            if posteriors is not None:
                across = Distances(self._places, inputs).covariance(prior, setting)
                spread = spread - _explain(across, posteriors[kind])[1]
            found[kind] = np.sqrt(np.maximum(np.diag(spread), 0.0) / prior.scale)
        return found

    def _possible(self) -> list[int]:
        """Return the settings that the cells leave possible."""
        least = self._weights.max() + _IMPOSSIBLE
        return np.flatnonzero(self._weights >= least).tolist()

    def _condition(self) -> None:
        """Bring the posteriors up to date; all settings are judged anew now and then."""
        if self._current:
            return
        self._current = True
        cells = list(self._cells.values())
        self._places = np.array([cell.inputs for cell in cells])
        values = np.array([cell.values for cell in cells])
        noise = NOISE / np.array([cell.weight for cell in cells])
        judge = self.blocks >= 1.1 * self._judged
        within = Distances(self._places, self._places)
        for number in range(len(self._settings)) if judge else self._possible():
            self._posteriors[number] = {
                kind: _given(prior, self._settings[number], within, self._places, values, noise)
                for kind, prior in PRIORS.items()
            }
        if judge:
            self._judged = self.blocks
            evidence = [
                sum(posterior.evidence for posterior in (posteriors or {}).values())
                for posteriors in self._posteriors
            ]
            self._weights = np.array(evidence) - np.logaddexp.reduce(evidence)


def _given(
    prior: Prior,
    setting: Setting,
    within: Distances,
    places: FloatArray,
    values: FloatArray,
    noise: FloatArray,
) -> _Posterior:
    matrix = within.covariance(prior, setting)
    matrix.flat[:: len(matrix) + 1] += setting.noise * noise
    factor = _factorise(matrix)
    rest = values[:, prior.first : prior.last] - mean_of(prior, places)
    return _Posterior(factor, _solve(factor, rest))


def _explain(across: FloatArray, posterior: _Posterior) -> tuple[FloatArray, FloatArray]:
    """Return what cells explain at n inputs, (n, c), and the variance that goes with it, (n, n)."""
    seen = _solve(posterior.factor, across)
    return seen.T @ posterior.whitened, seen.T @ seen


def _log_density(rest: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the log densities of the first rest (n, c), the first two, and so on, shape (n,)."""
    factor = _factorise(spread)
    squares = np.square(_solve(factor, rest)).sum(axis=1)
    scatter = rest.shape[1] * (2.0 * np.log(factor.diagonal()) + _LOG_TWO_PI)
    total: FloatArray = -0.5 * np.cumsum(squares + scatter)
    return total


def _factorise(matrix: FloatArray) -> FloatArray:
    """Return the lower Cholesky factor (n, n), by LAPACK itself: n is small, and calls are many."""
    factor: FloatArray
    factor, fault = dpotrf(matrix, lower=1)
    assert fault == 0, "the noise keeps every covariance definite"  # noqa: S101 - as derived above
    return factor


def _solve(factor: FloatArray, right: FloatArray) -> FloatArray:
    solved: FloatArray
    solved, _ = dtrtrs(factor, right, lower=1)
    return solved


def _key(inputs: FloatArray) -> tuple[int, ...]:
    """Return the cell in which inputs lie."""
    key = [int(np.floor(value / _CELL_WIDTH)) for value in inputs[:2].tolist()]
    if len(inputs) == 4:
        turn = float(np.arctan2(inputs[3], inputs[2])) / (2.0 * np.pi)
        key.append(int(np.floor(turn * _SECTORS)))
    return tuple(key)
