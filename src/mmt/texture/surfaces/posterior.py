"""Posterior of one surface given its blocks, and the likelihood of further blocks under it.

Blocks that are close to each other in the input plane are merged into *cells*, so that the cost
does not grow with time: n cells, `LARGEST` at most. The posterior of the Gaussian processes of
`mmt.texture.surfaces.prior` given the cells predicts any further blocks jointly: their level and
shape share the uncertainty of the surface, and each has the noise of a block. The roughness of the
surface is unknown: the density is the mean over the settings of the prior, each weighted by the
evidence of the cells (Rasmussen and Williams, chapter 5). It is exact for the model assumed, so
that its ratio between two surfaces is a Bayes factor.

Cost: with n = 100 about 1 ms for each setting that is still possible after blocks were added,
mostly one or two, and as much to predict 25 blocks; 4 ms for an unknown surface, for all settings
at once. Stability: covariances are positive definite by the noise on their diagonal, `NOISE` over
the number of blocks in a cell, against a largest prior variance of about 65: with `LARGEST` cells a
condition number below 1e7.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from mmt.core.arrays import FloatArray, RecordArray
from mmt.texture.surfaces.block_likelihood import PreparedBlocks, log_densities
from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.covariance import Covariances, SettingInputs
from mmt.texture.surfaces.prior import NOISE, PRIORS, SETTINGS, cosine_transform

LARGEST: Final = 250
"""Largest number of cells of a surface; beyond, the least recently touched one is dropped."""

SHARED: Final = 0.02
"""Share of the weight of all settings that is redistributed evenly at each possible change."""

_CELL_WIDTH: Final = 0.2  # of the logarithms of speed and force
_SECTORS: Final = 12
_LARGEST_WEIGHT: Final = 30.0
_IMPOSSIBLE: Final = -12.0  # of a setting's weight, as a logarithm, below that of the likeliest
_HOPELESS: Final = -50.0  # so far below it is not even judged again
_TOGETHER: Final = 8  # settings that are conditioned in one array


@dataclass
class _Cell:
    inputs: FloatArray
    values: FloatArray
    weight: float = 1.0

    def merge(self, inputs: FloatArray, values: FloatArray) -> None:
        """Add a block to the means; beyond the largest weight old blocks fade."""
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
        """Natural logarithm of the evidence, up to a constant."""
        logarithms = float(np.log(np.diag(self.factor)).sum())
        return -0.5 * float(np.square(self.whitened).sum()) - len(self.whitened.T) * logarithms


class SurfacePosterior:
    """Posterior of one surface; without blocks it is the prior, an unknown surface.

    Parameters
    ----------
    settings
        Settings of the prior: possible roughness of the surface.
    """

    def __init__(self, settings: RecordArray = SETTINGS) -> None:
        self.settings = settings
        self._cells: dict[tuple[int, ...], _Cell] = {}
        self._places = SettingInputs(np.empty((0, 4)), settings)
        self._before = np.log(settings["weight"] / settings["weight"].sum())
        self._weights = self._before
        self._posteriors: dict[int, dict[str, _Posterior]] = {}
        self._judged = 0
        self._current = True
        self.blocks = 0
        """Number of blocks added."""

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self._cells)

    @property
    def headings(self) -> FloatArray:
        """Cosines and sines of the headings of the cells, shape (n, 2) or (n, 0)."""
        if not self._cells:
            return np.empty((0, 2))
        return np.array([cell.inputs[2:] for cell in self._cells.values()])

    def add(self, blocks: Sequence[SurfaceBlock]) -> None:
        """Add blocks of this surface to the posterior."""
        for block in blocks:
            values = cosine_transform() @ block.log_power
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

    def log_likelihood(self, heard: PreparedBlocks) -> FloatArray:
        """Return the joint log likelihoods of the first block, the first two, and so on.

        Natural logarithms of densities, shape (n,).
        """
        total: FloatArray = np.logaddexp.reduce(self._by_setting(heard), axis=0)
        return total

    def log_likelihood_after(self, heard: PreparedBlocks) -> FloatArray:
        """Return the log likelihoods of all blocks, all but the first, ..., given those before.

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

    def _by_setting(self, heard: PreparedBlocks) -> FloatArray:
        """Return the weighted likelihoods (settings that are possible, n) of `log_likelihood`."""
        self._condition()
        possible = self._possible()
        if not self._cells:
            alone: FloatArray = self._weights[possible, None] + heard.unknown[possible]
            return alone
        places, known = heard.places.under(possible), self._places.under(possible)
        across = Covariances(known, places)
        each = np.repeat(self._weights[possible, None], len(heard), axis=1)
        for kind, prior in PRIORS.items():
            rests, spreads = heard.rests[kind], heard.covariances[kind][possible]
            rests = np.repeat(rests, len(possible), axis=0) if len(rests) == 1 else rests[possible]
            for row, between in enumerate(across.of(prior)):
                explained, sure = _explain(between, self._posteriors[possible[row]][kind])
                rests[row] -= explained
                spreads[row] -= sure
            each += log_densities(rests, spreads)
        return each

    @property
    def likeliest(self) -> int:
        """Index of the setting of largest posterior weight."""
        self._condition()
        return int(np.argmax(self._weights))

    def spread(self, inputs: FloatArray) -> dict[str, FloatArray]:
        """Return the posterior spread of each kind of component at inputs (n, d).

        Standard deviations (n,) in natural logarithms of the power in a band, without the noise
        of a block, under the likeliest setting.
        """
        number = self.likeliest
        places = SettingInputs(inputs, self.settings[[number]])
        within = Covariances(places, places)
        across = Covariances(self._places.under([number]), places) if self._cells else None
        found = {}
        for kind, prior in PRIORS.items():
            spread = within.of(prior)[0]
            if across is not None:
                spread -= _explain(across.of(prior)[0], self._posteriors[number][kind])[1]
            found[kind] = np.sqrt(np.maximum(np.diag(spread), 0.0) / prior.scale)
        return found

    def _possible(self, least: float = _IMPOSSIBLE) -> list[int]:
        """Return the indices of settings whose weight is not negligible."""
        return np.flatnonzero(self._weights >= self._weights.max() + least).tolist()

    def _condition(self) -> None:
        """Update the posteriors; at intervals reweight all settings that are not ruled out."""
        if self._current:
            return
        self._current = True
        cells = list(self._cells.values())
        self._places = SettingInputs(np.array([cell.inputs for cell in cells]), self.settings)
        values = np.array([cell.values for cell in cells])
        noise = NOISE / np.array([cell.weight for cell in cells])
        judge = self.blocks >= 1.1 * self._judged
        numbers = self._possible(_HOPELESS) if judge else self._possible()
        self._posteriors = {}
        for start in range(0, len(numbers), _TOGETHER):
            some = numbers[start : start + _TOGETHER]
            given = _given(self._places.under(some), values, noise)
            self._posteriors |= dict(zip(some, given, strict=True))
        if judge:
            self._judged = self.blocks
            weights = np.full(len(self.settings), -np.inf)
            for number in numbers:
                evidence = [each.evidence for each in self._posteriors[number].values()]
                weights[number] = self._before[number] + sum(evidence)
            self._weights = weights - np.logaddexp.reduce(weights)


def _given(
    places: SettingInputs, values: FloatArray, noise: FloatArray
) -> list[dict[str, _Posterior]]:
    """Return the posteriors under k settings by kind, given n cells (n, `BANDS`)."""
    within = Covariances(places, places)
    found: list[dict[str, _Posterior]] = [{} for _ in places.settings]
    for kind, prior in PRIORS.items():
        means = np.broadcast_to(places.mean(prior), places.law.shape)
        for row, matrix in enumerate(within.of(prior)):
            matrix.flat[:: len(matrix) + 1] += places.settings["noise"][row] * noise
            factor = _factorise(matrix)
            rest = values[:, prior.first : prior.last] - means[row][:, None]
            found[row][kind] = _Posterior(factor, _solve(factor, rest))
    return found


def _explain(across: FloatArray, posterior: _Posterior) -> tuple[FloatArray, FloatArray]:
    """Return what cells explain at n inputs, (n, c), and the variance that goes with it, (n, n)."""
    seen = _solve(posterior.factor, across)
    return seen.T @ posterior.whitened, seen.T @ seen


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
