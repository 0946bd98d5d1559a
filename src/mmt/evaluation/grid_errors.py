"""A model's errors at many strokes, and by the sector of their heading."""

from dataclasses import dataclass

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.evaluation.levels import root_mean_square
from mmt.evaluation.strokes import SECTOR_DEG, SECTORS, Strokes
from mmt.texture.signals.metrics import within_jnd


@dataclass(frozen=True)
class GridErrors:
    """Errors at k strokes, each of shape (k,).

    ``gfc`` compares the spectra at the resolution of every measured GFC (Welch, 64 samples),
    ``gfc_fine`` at 2 Hz; ``power_error_db`` and ``log_spectral_db`` are in dB, and so is
    ``bands_db``, shape (k, 9), of `mmt.evaluation.bands`.
    """

    gfc: FloatArray
    gfc_fine: FloatArray
    power_error_db: FloatArray
    log_spectral_db: FloatArray
    bands_db: FloatArray


@dataclass(frozen=True)
class SectorErrors:
    """The errors of all strokes of a sector of headings.

    ``heading_deg`` is its middle, None over all headings. ``gfc``, ``gfc_fine``,
    ``log_spectral_db`` and ``power_bias_db`` are means, ``power_error_db`` is the root mean
    square, ``within_jnd`` the share of strokes whose level is off by at most one JND.
    """

    heading_deg: float | None
    gfc: float
    gfc_fine: float
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
        What the errors are of.
    strokes
        At least one in each sector.
    errors
        At these strokes.
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
        gfc_fine=float(errors.gfc_fine[chosen].mean()),
        log_spectral_db=float(errors.log_spectral_db[chosen].mean()),
        power_error_db=root_mean_square(level_db),
        power_bias_db=float(level_db.mean()),
        within_jnd=within_jnd(level_db),
    )
