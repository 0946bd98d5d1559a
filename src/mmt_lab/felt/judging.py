"""Errors of the vibration felt, moment by moment, and delays of its beginnings and ends."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.devices.haptuator.driver import VoltageDrive
from mmt.devices.haptuator.options import HaptuatorOptions
from mmt.evaluation.model_errors import BANDS, band_membership
from mmt.testing.simulation import RATE_HZ
from mmt_lab.felt.passing import Passage

WINDOW: Final = 200
"""Samples in a moment, weighted by a Hann window."""

HOP: Final = 50
"""Samples from moment to moment."""

LEAST_RMS_M_S2: Final = 0.1
"""Weaker vibration counts as this: it is hardly felt, and sensor noise is as strong."""

STROKE_MM_S: Final = 10.0
STROKE_N: Final = 0.1
REST_TICKS: Final = 150
STROKE_TICKS: Final = 250
"""Least rest before a beginning and after an end of a stroke, and least length of the stroke."""

_ACTUATOR: Final = HaptuatorOptions(volts_per_m_s2=1.0, full_scale_v=100.0)
"""A Haptuator that is driven within the band of its data sheet, and even there."""
_FREQUENCIES_HZ: Final = np.linspace(0.0, RATE_HZ / 2.0, WINDOW // 2 + 1)
_MEMBERSHIP: Final = band_membership(_FREQUENCIES_HZ)
_PLAYED: Final = np.square(VoltageDrive(_ACTUATOR, RATE_HZ).gain(_FREQUENCIES_HZ))
_EDGE_WINDOW: Final = 30
_SEARCH_TICKS: Final = 900
_QUIET_TICKS: Final = 50


@dataclass(frozen=True)
class FeltErrors:
    """Errors of one method over one session.

    Attributes
    ----------
    time_s
        Time of each moment at which vibration is expected or felt, shape (k,).
    level_db, bands_db
        Error of the power, shape (k,), and of the power in each band, shape (k, 9).
    skin_db
        Error of the power behind the actuator, shape (k,).
    onset_ms, offset_ms
        How much later than without a network vibration begins and ends: for each stroke after a
        rest, and each rest after a stroke, if the edge is found in both vibrations.
    """

    time_s: FloatArray
    level_db: FloatArray
    bands_db: FloatArray
    skin_db: FloatArray
    onset_ms: FloatArray
    offset_ms: FloatArray


class Reference:
    """Exact powers of the surface at the hand's motion at each moment.

    Parameters
    ----------
    passage
        The session.
    at_once
        A realisation of the surface's vibration (n,), which gives the beginnings and ends.
    """

    def __init__(self, passage: Passage, at_once: FloatArray) -> None:
        self._bands = _expected_bands(passage)
        self._at_once = at_once
        stroking = (passage.speed_mm_s > STROKE_MM_S) & (passage.force_n > STROKE_N)
        self._begins = _changes(~stroking, REST_TICKS, STROKE_TICKS)
        self._ends = _changes(stroking, STROKE_TICKS, REST_TICKS)

    def judge(self, vibration_m_s2: FloatArray) -> FeltErrors:
        """Compare the vibration felt (n,) with the reference."""
        floor = LEAST_RMS_M_S2**2
        spectra = _measured_spectra(vibration_m_s2)
        bands, at_skin = spectra @ _MEMBERSHIP, spectra @ (_PLAYED * _MEMBERSHIP.sum(axis=1))
        power, wanted = bands.sum(axis=1), self._bands.sum(axis=1)
        counts = (power > floor) | (wanted > floor)
        middle = (np.arange(len(bands), dtype=np.float64) * HOP + WINDOW / 2.0) / RATE_HZ
        return FeltErrors(
            time_s=middle[counts],
            level_db=_ratio_db(power, wanted, floor)[counts],
            bands_db=_ratio_db(bands, self._bands, floor / BANDS)[counts],
            skin_db=_ratio_db(at_skin, wanted, floor)[counts],
            onset_ms=self._delays(vibration_m_s2, self._begins, rising=True),
            offset_ms=self._delays(vibration_m_s2, self._ends, rising=False),
        )

    def _delays(self, vibration_m_s2: FloatArray, edges: IntArray, *, rising: bool) -> FloatArray:
        """Return by how many ms the edges of a vibration come later than those of `at_once`."""
        levels = [_short_power(v) for v in (vibration_m_s2, self._at_once)]
        found = []
        for edge in edges.tolist():
            span = slice(max(edge - REST_TICKS, 0), edge + _SEARCH_TICKS)
            inside = (
                slice(edge, edge + STROKE_TICKS) if rising else slice(edge - STROKE_TICKS, edge)
            )
            threshold = max(0.25 * float(levels[1][inside].mean()), LEAST_RMS_M_S2**2)
            late, own = (_crossing(level[span], threshold, rising=rising) for level in levels)
            if late is not None and own is not None:
                found.append(float(late - own))
        return np.array(found)


def _expected_bands(passage: Passage) -> FloatArray:
    """Return the mean power in each band over each moment's window, shape (k, 9)."""
    unit = passage.heading
    heading = np.arctan2(unit[:, 1], unit[:, 0])
    frequencies = np.arange(501.0)
    member = band_membership(frequencies)
    # the motion is slow: a value every ten ticks is enough
    chosen = np.arange(0, len(passage.force_n), 10)
    density = passage.surface.spectrum(
        passage.speed_mm_s[chosen], passage.force_n[chosen], frequencies, heading[chosen]
    )
    bands = density @ member
    windows = sliding_window_view(bands, WINDOW // 10, axis=0)[:: HOP // 10]
    weights = np.square(np.hanning(WINDOW // 10 + 2)[1:-1])
    return np.asarray(windows @ (weights / weights.sum()))


def _measured_spectra(vibration_m_s2: FloatArray) -> FloatArray:
    """Return the power at `_FREQUENCIES_HZ` in each moment's window, shape (k, 101)."""
    window = np.hanning(WINDOW + 1)[:-1]
    pieces = sliding_window_view(vibration_m_s2, WINDOW)[::HOP] * window
    square = np.square(np.abs(np.fft.rfft(pieces, axis=1)))
    return np.asarray(square * 2.0 / (WINDOW * np.square(window).sum()))


def _ratio_db(power: FloatArray, wanted: FloatArray, floor: float) -> FloatArray:
    return np.asarray(10.0 * np.log10(np.maximum(power, floor) / np.maximum(wanted, floor)))


def _changes(before: BoolArray, ticks_before: int, ticks_after: int) -> IntArray:
    """Return the ticks at which a state ends that held `ticks_before`, and is off `ticks_after`."""
    found = []
    for edge in (np.flatnonzero(before[:-1] & ~before[1:]) + 1).tolist():
        held = before[max(edge - ticks_before, 0) : edge]
        after = before[edge : edge + ticks_after]
        whole = len(held) == ticks_before and len(after) == ticks_after
        if whole and held.all() and not after.any():
            found.append(edge)
    return np.array(found, dtype=np.int64)


def _short_power(vibration_m_s2: FloatArray) -> FloatArray:
    """Return the mean square of the newest 30 samples at each tick, shape (n,)."""
    sums = np.concatenate([[0.0], np.cumsum(np.square(vibration_m_s2))])
    ends = np.arange(1, len(sums))
    starts = np.maximum(ends - _EDGE_WINDOW, 0)
    return np.asarray((sums[ends] - sums[starts]) / (ends - starts))


def _crossing(level: FloatArray, threshold: float, *, rising: bool) -> int | None:
    """Return the index at which a level first rises above the threshold, or first stays below.

    Vibration left over from the stroke before does not count as a rise.
    """
    above = level > threshold
    if rising:
        rises = np.flatnonzero(above[1:] & ~above[:-1]) + 1
        return int(rises[0]) if len(rises) else None
    quiet = np.flatnonzero(~sliding_window_view(above, _QUIET_TICKS).any(axis=1))
    return int(quiet[0]) if len(quiet) else None
