"""Blocks of vibration by which surfaces are told apart, and their regression on the strokes.

The stream is cut by `mmt.texture.field.blocks`. A block's spectrum is estimated with sine tapers
(Riedel and Sidorenko, "Minimum bias multiple taper spectral estimation", IEEE Trans. Signal
Processing 43(1), 1995) and added up in eight bands of 60 Hz from 10 to 490 Hz. The logarithms of
the powers are close to normal, with a spread that does not depend on the level. An orthogonal
cosine transform turns them into their mean, the *level*, their *tilt*, and ever finer features of
the *shape*, of which the first `COMPONENTS` are kept: the finer ones are mostly scatter in so short
a time.

Each component is linear in u and v (`mmt.texture.field.covariance`) plus a smooth departure: a
Gaussian process with Matern covariances of smoothness 3/2, in the reduced-rank form of Solin and
Sarkka ("Hilbert space methods for reduced-rank Gaussian process regression", Statistics and
Computing 30, 2020), sines whose weights have the process's spectral density as variance. If the
heading counts, its first two harmonics are added. The variance of blocks about the regression is
learned too: it has an inverse gamma prior, so that blocks are predicted by Student's t
distribution. All is conjugate and in closed form (Bishop, Pattern Recognition and Machine Learning,
2006, section 3.3).

The figures of the prior are the spread among the development half of HaTT's models, component by
component, rounded up.
"""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from scipy.fft import dct
from scipy.special import gammaln

from mmt.core.arrays import BoolArray, FloatArray
from mmt.texture.field import blocks as field_blocks
from mmt.texture.field.blocks import mean_square
from mmt.texture.field.covariance import coordinates
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock, NoiseFloor

MEANS: Final = np.array([-2.6, 1.7, -0.3, 0.15, 0.0, 0.0])
"""Prior means of the components, nepers of power in (m/s2)^2."""

_CONSTANTS: Final = np.array([3.0, 0.7, 0.5, 0.25, 0.2, 0.15])
"""Standard deviations of the components from surface to surface."""

_SIZES: Final = np.array([1.0, 0.5, 0.3, 0.2, 0.15, 0.12])
"""Size of each component's changes with the stroke, over that of the level's."""

_SCATTER: Final = 1.5 * np.array([0.05, 0.05, 0.045, 0.04, 0.032, 0.025])
"""Expected variance of blocks, nepers^2: one and a half times that of white noise (measured)."""

_PRIOR_BLOCKS: Final = 20.0
"""Number of blocks that the expected variance counts as."""

_SLOPE, _DEPARTURE, _HEADING = 0.5, 0.6, 0.4
"""Standard deviations for a component of size 1: of slopes, of the departure, of a harmonic."""

_LENGTHS: Final = (0.6, 0.8)
"""Lengths of the departure in u and v."""

_CENTRE, _HALF_WIDTH = -1.1, 2.6
"""Square of u and v at whose edges the sines vanish."""

_WAVES: Final = np.pi * np.arange(1, 7) / (2.0 * _HALF_WIDTH)
"""Wave numbers of the sines on each axis."""

LARGEST: Final = 4.8
"""Bound on the innovation of a block, in standard deviations (root of the sum of squares over the
components). A larger one, as of a knock, counts and is learned as this large."""


def features(strokes: FloatArray, *, directed: bool) -> FloatArray:
    """Return the regressors (n, d) of strokes (n, 3): u, v and heading.

    ``directed``: whether the heading counts.
    """
    u, v, heading = strokes.T
    place = np.clip(strokes[:, :2] - _CENTRE, -_HALF_WIDTH, _HALF_WIDTH) + _HALF_WIDTH
    sines = np.sin(place[:, :, None] * _WAVES) / np.sqrt(_HALF_WIDTH)
    departure = (sines[:, 0, :, None] * sines[:, 1, None, :]).reshape(len(strokes), -1)
    columns = [np.ones(len(strokes)), u, v]
    if directed:
        columns += [np.cos(heading), np.sin(heading), np.cos(2 * heading), np.sin(2 * heading)]
    return np.column_stack([*columns, departure])


@cache
def _prior_precision(*, directed: bool) -> FloatArray:
    """Return the prior precisions of the weights times the variance of blocks, (components, d)."""
    rates = np.sqrt(3.0) / np.array(_LENGTHS)[:, None]
    densities = 4.0 * rates**3 / np.square(rates**2 + _WAVES**2)
    departure = _DEPARTURE * np.sqrt(np.outer(*densities)).ravel()
    stroke = [_SLOPE, _SLOPE, *([_HEADING] * 4 if directed else []), *departure]
    deviations = np.column_stack([_CONSTANTS, np.outer(_SIZES, stroke)])
    return np.asarray(_SCATTER[:, None] / np.square(deviations))


class Innovations(NamedTuple):
    """Innovations of n blocks, bounded by `LARGEST`.

    ``deviation``: standard deviation of each block's prediction, over that of the scatter;
    ``innovation``: prediction error over ``deviation``; ``values``: the components that have these
    innovations; all (`COMPONENTS`, n). ``shape`` (n,) and ``rate`` (`COMPONENTS`, n): parameters of
    the inverse gamma distribution of the variance before each block.
    """

    deviation: FloatArray
    innovation: FloatArray
    values: FloatArray
    shape: FloatArray
    rate: FloatArray


class SurfaceRegression:
    """Regression of the components of one surface's blocks; without blocks it is the prior.

    Parameters
    ----------
    directed
        Whether the heading counts.
    """

    def __init__(self, *, directed: bool) -> None:
        precision = _prior_precision(directed=directed)
        self._precision = precision[:, :, None] * np.eye(precision.shape[1])
        self.covariance = np.eye(precision.shape[1]) / precision[:, :, None]
        self._weighted = np.zeros_like(precision)
        self.shape = 0.5 * _PRIOR_BLOCKS
        self.rate: FloatArray = np.asarray(self.shape * _SCATTER)

    def log_densities(self, rows: FloatArray, values: FloatArray) -> FloatArray:
        """Return the log density (n,) of n blocks, given learned blocks and those before each.

        Parameters
        ----------
        rows, values
            `features` (n, d) and components less `MEANS` (n, `COMPONENTS`) of the blocks.
        """
        found = self.innovations(rows, values)
        shape, rate = found.shape, found.rate
        densities = gammaln(shape + 0.5) - gammaln(shape) - 0.5 * np.log(2.0 * np.pi * rate)
        squares = np.square(found.innovation) / rate
        densities -= np.log(found.deviation) + (shape + 0.5) * np.log1p(0.5 * squares)
        return np.asarray(densities.sum(axis=0))

    def learn(self, rows: FloatArray, values: FloatArray) -> None:
        """Learn n blocks, n > 0, in their order; parameters as of `log_densities`."""
        found = self.innovations(rows, values)
        self._precision = self._precision + rows.T @ rows
        self.covariance = np.asarray(np.linalg.inv(self._precision), dtype=np.float64)
        self._weighted = self._weighted + found.values @ rows
        self.shape += 0.5 * len(rows)
        self.rate = np.asarray(self.rate + 0.5 * np.square(found.innovation).sum(axis=1))

    def innovations(self, rows: FloatArray, values: FloatArray) -> Innovations:
        """Return the innovations of n blocks, given learned blocks and those before each."""
        mean = np.einsum("cde,ce,nd->cn", self.covariance, self._weighted, rows)
        factor = np.linalg.cholesky(rows @ self.covariance @ rows.T + np.eye(len(rows)))
        deviation = np.diagonal(factor, axis1=1, axis2=2)
        shape: FloatArray = np.asarray(self.shape + 0.5 * np.arange(len(rows)))
        innovation, rate = np.zeros_like(mean), np.zeros_like(mean)
        now = self.rate
        for n, rest in enumerate((values.T - mean).T):  # forward substitution, bounded at each step
            told = (factor[:, n, :n] * innovation[:, :n]).sum(axis=1)
            new = (rest - told) / deviation[:, n]
            size = float(np.sqrt((np.square(new) * shape[n] / now).sum()))
            innovation[:, n] = new * (LARGEST / max(size, LARGEST))
            rate[:, n] = now
            now = now + 0.5 * np.square(innovation[:, n])
        tamed = mean + np.einsum("cnk,ck->cn", factor, innovation)
        return Innovations(deviation, innovation, tamed, shape, rate)


COMPONENTS: Final = 6
"""Number of components of a block's spectrum."""

_BANDS: Final = 8
_TAPERS: Final = 3
_BINS: Final = 3
"""Frequencies of a band: a block of a twentieth of a second resolves 20 Hz."""

_LEAST_POWER: Final = 1e-12
"""Least power in (m/s2)^2: a stuck sensor measures none at all."""

AUDIBLE: Final = 4.0
"""Least ratio of a block's power to the sensor's noise. In noise all surfaces are alike, and close
to it the spectrum of a texture changes faster than anywhere else."""


def spectrum_components(vibration_m_s2: FloatArray) -> FloatArray:
    """Return the components of blocks' spectra, (n, `COMPONENTS`), in nepers of power.

    Parameters
    ----------
    vibration_m_s2
        Shape (n, m, axes): n blocks of `mmt.texture.field.blocks.BLOCK_S`, at 1 kHz or more. The
        powers of several axes are added.
    """
    samples = vibration_m_s2.shape[1]
    turns = np.outer(np.arange(1, _TAPERS + 1), np.arange(1, samples + 1)) / (samples + 1)
    tapers = np.sqrt(2.0 / (samples + 1)) * np.sin(np.pi * turns)
    spectra = np.fft.rfft(tapers[:, :, None] * vibration_m_s2[:, None], axis=2)
    chosen = spectra[:, :, 1 : 1 + _BANDS * _BINS]
    density = (chosen.real**2 + chosen.imag**2).sum(axis=3).mean(axis=1)
    power = 2.0 / samples * density.reshape(-1, _BANDS, _BINS).sum(axis=2)
    logarithm = np.log(np.maximum(power, _LEAST_POWER))
    return np.asarray(dct(logarithm, norm="ortho")[:, :COMPONENTS] / np.sqrt(_BANDS))


@dataclass(frozen=True, eq=False)
class SurfaceBlock:
    """Features of one block.

    ``start`` and ``stop`` are absolute sample numbers, half-open. ``stroke`` (3,): u, v and heading
    as in `mmt.texture.field.covariance`. ``values`` (`COMPONENTS`,): components of the
    spectrum less their prior means, in nepers of power.
    ``touchdown``: whether it is the first block after the tool met a surface. ``contact_start``:
    the sample number at which this contact began.
    """

    start: int
    stop: int
    stroke: FloatArray
    values: FloatArray
    touchdown: bool
    contact_start: int


class SurfaceBlockCutter:
    """Cut a stream of aligned samples into blocks, update by update.

    Parameters
    ----------
    modelling
        Settings of the modelling: axes, least speed and force, inputs.
    """

    def __init__(self, modelling: ModellingSettings) -> None:
        self._pressed_n = 0.5 * modelling.least_force_n
        self._cutter = field_blocks.BlockCutter(modelling, self._measure)
        self._noise = NoiseFloor()
        self._rest = AlignedBlock.empty()
        self._lifted = True
        self._contact_start = 0
        self._fresh = False

    def cut(self, aligned: AlignedBlock) -> list[SurfaceBlock]:
        """Add the next samples, any number of them, and return the blocks they complete.

        The partition of the stream does not change the blocks.
        """
        if not len(aligned):
            return []
        joined = AlignedBlock.concatenate([self._rest, aligned]) if len(self._rest) else aligned
        number = joined.index // self._cutter.length
        edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist()]
        if joined.index[-1] % self._cutter.length == self._cutter.length - 1:
            edges.append(len(joined))
        found: list[SurfaceBlock] = []
        for start, stop in pairwise(edges):
            found += self._cut(joined[start:stop])
        self._rest = joined[edges[-1] :]
        return found

    def _cut(self, part: AlignedBlock) -> list[SurfaceBlock]:
        """Return the block of samples of one block's time, if they hold one."""
        self._watch(part)
        blocks = self._cutter.cut([part])
        self._noise.update(part)
        if not len(blocks.start):
            return []
        touchdown, self._fresh = self._fresh, False
        start, at = int(blocks.start[0]), coordinates(blocks.points)
        values = blocks.power[0] - MEANS
        values[0] -= at.law[0]
        return [
            SurfaceBlock(
                start=start,
                stop=start + self._cutter.length,
                stroke=np.column_stack(at)[0],
                values=values,
                touchdown=touchdown,
                contact_start=self._contact_start,
            )
        ]

    def _measure(self, vibration_m_s2: FloatArray, measured: BoolArray) -> FloatArray:
        """Return the components of blocks' spectra, NaN for blocks of nothing but noise."""
        found = spectrum_components(vibration_m_s2)
        found[mean_square(vibration_m_s2, measured) < AUDIBLE * self._noise.power] = np.nan
        return found

    def _watch(self, part: AlignedBlock) -> None:
        """Record the beginning of a contact."""
        pressed = np.concatenate([[not self._lifted], part.normal_force_n > self._pressed_n])
        begun = np.flatnonzero(pressed[1:] & ~pressed[:-1])
        if len(begun):
            self._contact_start, self._fresh = int(part.index[begun[-1]]), True
        self._lifted = not bool(pressed[-1])
