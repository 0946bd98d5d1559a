"""Errors of a model: of level at many points, by bands of frequency, and over a grid of strokes.

The whole plane is that of `mmt.texture.completion.distance`; the strokes made in a session
are those of `mmt.evaluation.strokes_made`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.texture.autoregression.burg import relative_density, shares
from mmt.texture.autoregression.forms import lsf_to_ar
from mmt.texture.completion.distance import FORCE_RANGE_N, SPEED_RANGE_MM_S, middles
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.signals.metrics import power_error_db, within_jnd
from mmt.texture.space import InputSpace

LARGEST_ERROR_DB: Final = 60.0
"""Errors are limited to this, so that one silent point does not make a mean infinite."""

WORST: Final = 5
"""Number of worst sessions whose mean is reported."""

LEAST_POWER: Final = 1e-4
"""Least power, (m/s2)^2, as which smaller ones count: 0.01 m/s2 rms, less than a hand feels or an
accelerometer measures. Two smaller powers are equal, however many dB lie between them."""

LEAST_DENSITY: Final = LEAST_POWER / 500.0
"""Least density, (m/s2)^2 per hertz: the least power spread evenly over 0 to 500 Hz."""

WELCH_S: Final = 0.064
"""Length of the windows of every measured GFC: bins of 15.6 Hz."""

LOWEST_HZ: Final = 8
"""Lowest frequency that counts in the level; the high-pass leaves 0.29 of a power there."""

FELT_HZ: Final = 1000
"""Highest frequency that counts in the level, unless half the rate is lower. Vibration is felt to
about 1 kHz (Verrillo 1963; Bolanowski et al. 1988), and at most heard above."""

BANDS: Final = 9
"""Bands up to 500 Hz."""


def band_edges_hz(rate_hz: float) -> FloatArray:
    """Return the edges of bands of equal ratio, 0.63 octaves each, from 10 Hz to half a rate.

    Nine bands reach to 500 Hz, and as many more as fit best to half the rate, where the last one
    ends. The width of the critical bands of touch is not settled. That they widen with frequency,
    and that nine cover 10 to 500 Hz, is from the literature; the equal ratio is our choice. Those
    of the ear above 1 kHz have about equal ratios too, and are narrower (Glasberg and Moore 1990).
    """
    highest_hz = 0.5 * rate_hz
    count = round(BANDS * np.log(highest_hz / 10.0) / np.log(50.0))
    edges = np.geomspace(10.0, 10.0 * 50.0 ** (count / BANDS), count + 1)
    return np.append(edges[:-1], highest_hz)


BAND_EDGES_HZ: Final = band_edges_hz(1000.0)

_PERIOD: Final = 2048
"""Period of the spectra from which power above `FELT_HZ` is found: steps of 4.9 Hz at 10 kHz."""


def level_error_db(model: TextureModel, inputs: FloatArray, power: FloatArray) -> FloatArray:
    """Return the error in dB of a model's felt power at inputs (k, d) against `power` (k,)."""
    lsf, _, whole = model.filters(*inputs.T)
    above = power_above_felt(lsf_to_ar(lsf), whole, model.rate_hz)
    return power_level_error_db(whole - above, power)


def power_above_felt(ar: FloatArray, power: FloatArray, rate_hz: float) -> FloatArray:
    """Return the part (k,) of the power (k,) of filters (k, m) that is above `FELT_HZ`.

    It follows from the share in sums over their spectra. A line that is narrower than the steps
    counts too much or too little in both sums, so that no share exceeds one.
    """
    if 0.5 * rate_hz <= FELT_HZ:
        return np.zeros(len(power))
    density, weights = relative_density(ar, _PERIOD), shares(_PERIOD)
    above = int(FELT_HZ * _PERIOD / rate_hz) + 1
    return np.asarray(power * (density[:, above:] @ weights[above:]) / (density @ weights))


def power_level_error_db(power: FloatArray, reference: FloatArray) -> FloatArray:
    """Return 10 log10 of powers over their reference, (k,), bounded, none below `LEAST_POWER`."""
    return bounded_error_db(np.maximum(power, LEAST_POWER), np.maximum(reference, LEAST_POWER))


def bounded_error_db(values: FloatArray, reference: FloatArray) -> FloatArray:
    """Return 10 log10 of powers or densities over their reference, of any shape, bounded."""
    return np.clip(power_error_db(values, reference), -LARGEST_ERROR_DB, LARGEST_ERROR_DB)


class PooledFigure(NamedTuple):
    """One figure across sessions.

    ``worst`` is the mean of the `WORST` worst ones, ``below_half`` how many are below 0.5.
    """

    sessions: int
    median: float
    mean: float
    worst: float
    below_half: int


def across(values: Iterable[float], *, larger_is_better: bool = True) -> PooledFigure:
    """Gather one figure across sessions, at least one."""
    ordered = np.sort(np.fromiter(values, np.float64))
    worst = ordered[:WORST] if larger_is_better else ordered[-WORST:]
    return PooledFigure(
        len(ordered),
        float(np.median(ordered)),
        float(ordered.mean()),
        float(worst.mean()),
        int(np.count_nonzero(ordered < 0.5)),
    )


def root_mean_square(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def band_membership(frequencies_hz: FloatArray, edges_hz: FloatArray = BAND_EDGES_HZ) -> FloatArray:
    """Return which band each frequency belongs to, shape (f, b); none below 10 Hz."""
    band = np.searchsorted(edges_hz[:-1], frequencies_hz, side="right") - 1
    member: FloatArray = (band[:, None] == np.arange(len(edges_hz) - 1)).astype(np.float64)
    return member


def band_errors_db(
    density: FloatArray,
    reference: FloatArray,
    frequencies_hz: FloatArray,
    edges_hz: FloatArray = BAND_EDGES_HZ,
) -> FloatArray:
    """Return 10 log10 of the power in each band over that of the reference, shape (k, b).

    Parameters
    ----------
    density, reference
        Power spectral densities, shape (k, f).
    frequencies_hz
        Evenly spaced from 10 Hz to half the rate, shape (f,).
    edges_hz
        Edges of the bands, shape (b + 1,); those of 1 kHz by default.
    """
    weights = band_membership(frequencies_hz, edges_hz)
    return bounded_error_db(density @ weights, reference @ weights)


GRID_SPEED_MM_S: Final[FloatArray] = middles(SPEED_RANGE_MM_S, 12)
GRID_FORCE_N: Final[FloatArray] = middles(FORCE_RANGE_N, 12)

SECTORS: Final = 12
SECTOR_DEG: Final = 360.0 / SECTORS
_HEADINGS: Final = 24
"""Two in each sector; odd multiples of 7.5 degrees, so that none is along the axes."""


class Strokes(NamedTuple):
    """Speeds, forces and headings of strokes, each of shape (k,)."""

    speed_mm_s: FloatArray
    force_n: FloatArray
    heading_rad: FloatArray

    def at(self, index: int) -> Self:
        """Return one of the strokes, shape (1,)."""
        return type(self)(*(values[index : index + 1] for values in self))

    def inputs(self, space: InputSpace) -> FloatArray:
        """Return the strokes as the inputs of a model, shape (k, d)."""
        return space.from_motion(
            self.speed_mm_s * np.cos(self.heading_rad),
            self.speed_mm_s * np.sin(self.heading_rad),
            self.force_n,
        )

    @property
    def sector(self) -> IntArray:
        """The sector of each heading, 0 to `SECTORS` - 1 from x to y, shape (k,)."""
        turns = np.mod(self.heading_rad / (2.0 * np.pi), 1.0)
        return np.minimum((turns * SECTORS).astype(np.int64), SECTORS - 1)


def over_plane() -> Strokes:
    """Return strokes of one heading over the plane, 12 x 12, forces outermost."""
    speed, force = np.meshgrid(GRID_SPEED_MM_S, GRID_FORCE_N)
    return Strokes(speed.ravel(), force.ravel(), np.zeros(speed.size))


def all_headings() -> Strokes:
    """Return strokes over the plane at all headings, 6 x 6 x 24, forces outermost."""
    headings = (np.arange(_HEADINGS) + 0.5) * (2.0 * np.pi / _HEADINGS)
    plane = middles(FORCE_RANGE_N, 6), middles(SPEED_RANGE_MM_S, 6)
    force, speed, heading = np.meshgrid(*plane, headings, indexing="ij")
    return Strokes(speed.ravel(), force.ravel(), heading.ravel())


@dataclass(frozen=True)
class GridErrors:
    """Errors at k strokes, each of shape (k,).

    ``gfc`` compares the spectra at the resolution of every measured GFC (Welch, 64 ms);
    ``power_error_db`` and ``log_spectral_db`` are in dB, and so is ``bands_db``, shape (k, b), of
    `band_errors_db`.
    """

    gfc: FloatArray
    power_error_db: FloatArray
    log_spectral_db: FloatArray
    bands_db: FloatArray


@dataclass(frozen=True)
class SectorErrors:
    """The errors of all strokes of a sector of headings.

    ``heading_deg`` is its middle, None over all headings. ``gfc``, ``log_spectral_db`` and
    ``power_bias_db`` are means, ``power_error_db`` is the root mean square, ``within_jnd`` the
    share of strokes whose level is off by at most one JND.
    """

    heading_deg: float | None
    gfc: float
    log_spectral_db: float
    power_error_db: float
    power_bias_db: float
    within_jnd: float


@dataclass(frozen=True)
class HeadingErrors:
    """One model against a known texture, by heading."""

    model: str
    overall: SectorErrors
    sectors: tuple[SectorErrors, ...]


def by_heading(model: str, strokes: Strokes, errors: GridErrors) -> HeadingErrors:
    """Gather the errors of the model of this name at strokes, at least one in each sector."""
    sectors = strokes.sector
    return HeadingErrors(
        model=model,
        overall=overall(errors),
        sectors=tuple(
            _gathered((number + 0.5) * SECTOR_DEG, errors, sectors == number)
            for number in range(SECTORS)
        ),
    )


def overall(errors: GridErrors) -> SectorErrors:
    """Gather the errors at all strokes."""
    return _gathered(None, errors, np.ones(len(errors.gfc), np.bool_))


def _gathered(heading_deg: float | None, errors: GridErrors, chosen: BoolArray) -> SectorErrors:
    level_db = errors.power_error_db[chosen]
    return SectorErrors(
        heading_deg=heading_deg,
        gfc=float(errors.gfc[chosen].mean()),
        log_spectral_db=float(errors.log_spectral_db[chosen].mean()),
        power_error_db=root_mean_square(level_db),
        power_bias_db=float(level_db.mean()),
        within_jnd=within_jnd(level_db),
    )
