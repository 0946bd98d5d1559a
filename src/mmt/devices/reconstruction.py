"""Weights that give a vibration's value between two readings from nine readings around it.

The least-squares fractional delay of T. I. Laakso, V. Valimaki, M. Karjalainen, U. K. Laine:
*Splitting the Unit Delay*, IEEE Signal Processing Magazine 13(1), 1996, section "general least
squares", with a little white noise beside the band so that nothing is amplified for its sake,
and with constants and straight lines kept exactly. Eight readings lie before the instant and one
after it: the value is there as soon as that of a straight line would be.
"""

from functools import lru_cache
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray

BEFORE: Final = 8
"""Readings before the instant that have a part in its value; one after it has."""

PHASES: Final = 256
"""Instants between two readings that have weights of their own; the nearest is taken."""

BAND_HZ: Final = 500.0
"""Half the session's rate: what lies above folds, whatever the weights."""

_SHARE: Final = 0.42
"""Of the sensor's rate: the band of a slow one. Near half its rate nothing can be had from
readings of the past without amplifying what is between."""
_NOISE: Final = 1e-3
"""Power beside the band, over that within it."""

Weights = tuple[tuple[float, ...], ...]
"""Rows by the instant, 0 at the reading before it to `PHASES` at the one after it; columns by the
reading, the oldest first."""


def band_of(rate_hz: float) -> float:
    """Return the band over a sensor's rate for which its weights are made."""
    return min(BAND_HZ / rate_hz, _SHARE)


@lru_cache(maxsize=8)
def weights(band: float) -> Weights:
    """Return the weights for a band from 0 up; some 0.3 ms.

    Parameters
    ----------
    band
        Highest frequency over the sensor's rate, above 0 and below 0.5.

    Raises
    ------
    ValueError
        There is no such band.
    """
    if not 0.0 < band < 0.5:
        raise ValueError(f"band is {band}: it must lie within 0 to half the rate")
    places = np.arange(1.0 - BEFORE, 2.0)
    instants = np.arange(PHASES + 1) / PHASES
    count = len(places)
    exact: FloatArray = np.vstack((np.ones(count), places))
    system = np.zeros((count + 2, count + 2))
    system[:count, :count] = np.sinc(2.0 * band * (places[:, None] - places))
    system[:count, :count] += _NOISE * np.eye(count)
    system[:count, count:], system[count:, :count] = exact.T, exact
    wanted = np.vstack(
        (
            np.sinc(2.0 * band * (places[:, None] - instants)),
            np.ones(len(instants)),
            instants,
        )
    )
    solved = np.linalg.solve(system, wanted)[:count]
    return tuple(tuple(row) for row in solved.T.tolist())
