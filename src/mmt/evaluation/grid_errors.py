"""Strokes at which a model is compared with a known texture, and its errors there.

The whole plane is that of `mmt.texture.completion.distance`; the strokes made in a session
are those of `mmt.evaluation.strokes_made`.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.evaluation.levels import root_mean_square
from mmt.texture.completion.distance import FORCE_RANGE_N, SPEED_RANGE_MM_S, middles
from mmt.texture.signals.metrics import within_jnd
from mmt.texture.space import InputSpace

GRID_SPEED_MM_S: Final[FloatArray] = middles(SPEED_RANGE_MM_S, 12)
GRID_FORCE_N: Final[FloatArray] = middles(FORCE_RANGE_N, 12)

COARSE_SPEED_MM_S: Final[FloatArray] = middles(SPEED_RANGE_MM_S, 6)
COARSE_FORCE_N: Final[FloatArray] = middles(FORCE_RANGE_N, 6)
"""Grid of the plane if all headings are compared as well."""

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
    force, speed, heading = np.meshgrid(COARSE_FORCE_N, COARSE_SPEED_MM_S, headings, indexing="ij")
    return Strokes(speed.ravel(), force.ravel(), heading.ravel())


@dataclass(frozen=True)
class GridErrors:
    """Errors at k strokes, each of shape (k,).

    ``gfc`` compares the spectra at the resolution of every measured GFC (Welch, 64 samples);
    ``power_error_db`` and ``log_spectral_db`` are in dB, and so is ``bands_db``, shape (k, 9), of
    `mmt.evaluation.levels`.
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
    """Gather the errors at strokes of all headings in sectors of 30 degrees.

    Parameters
    ----------
    model
        The name of the model.
    strokes
        At least one in each sector.
    errors
        The model's errors at these strokes.
    """
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
