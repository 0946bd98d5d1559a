"""Level and equaliser of an actuator, fitted to a sweep that an accelerometer measured.

The transfer function from voltage to acceleration is estimated over segments (H1: cross spectrum
over power spectrum) of the aligned signals. Its power mean over the band gives the level. The
equaliser corrects only the magnitude: its gain is the smoothed inverse of the transfer function's,
within a bound, and its phase is the minimum one (A. V. Oppenheim, R. W. Schafer: *Discrete-Time
Signal Processing*, the minimum-phase sequence from the real cepstrum). It is cut to a short FIR
filter, which adds no delay, cannot be unstable, and never amplifies beyond the bound.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.devices.haptuator.options import DATA_SHEET_LOW_HZ
from mmt.devices.protocols import USUAL_RATE_HZ

RATE_HZ: Final = USUAL_RATE_HZ
"""Rate at which a sweep is played and an equaliser is fitted; see `taps_at` for others."""
TAPS: Final = 32

_SEGMENT: Final = 256
_LEAST_SEGMENTS: Final = 16
_LEAST_COHERENCE: Final = 0.8
_LONGEST_SHIFT: Final = 200
_SMOOTHING: Final = 2
"""Neighbours on each side, 3.9 Hz apart, over which the squared magnitude is averaged."""
_FADE: Final = 8
_PROVISIONAL_HZ: Final = 100.0
"""From this frequency on, every actuator of this kind is within its band."""
_DRIVEN: Final = 1e-4
"""Share of the largest power of the voltage above which a frequency counts as driven."""
_FREQUENCIES_HZ: Final = np.fft.rfftfreq(_SEGMENT, 1.0 / RATE_HZ)

Spectrum = np.ndarray[tuple[int], np.dtype[np.complex128]]


_Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]


@dataclass(frozen=True)
class ActuatorLevel:
    """The level of an actuator on its handle, and its equaliser.

    Raises
    ------
    ValueError
        The response does not have one number for each frequency, or these do not rise.
    """

    volts_per_m_s2: Annotated[_Number, Field(gt=0)]
    taps: Annotated[tuple[_Number, ...], Field(min_length=1, max_length=TAPS)]
    """Taps of an FIR filter at 1 kHz, (1.0,) for none."""
    low_hz: Annotated[_Number, Field(ge=1, lt=RATE_HZ / 2)] = DATA_SHEET_LOW_HZ
    """Lowest frequency at which the actuator can be driven."""
    response_hz: tuple[_Number, ...] = ()
    """Frequencies at which its own response is known."""
    response: tuple[_Number, ...] = ()
    """Acceleration over voltage at these frequencies, m/s2 for 1 V, smoothed."""

    def __post_init__(self) -> None:
        rising = all(low < high for low, high in pairwise(self.response_hz))
        if not rising or len(self.response_hz) != len(self.response):
            raise ValueError("a response needs one number for each of its rising frequencies")


@dataclass(frozen=True, kw_only=True)
class Equaliser(ActuatorLevel):
    """A fitted level and equaliser, and the quality of the fit."""

    unevenness_db: float
    """Standard deviation of the level over the band, in dB, without the equaliser."""
    remaining_db: float
    """The same with the equaliser."""
    coherence: float
    """Share of the acceleration's power that the voltage explains, median over the band."""


def taps_at(taps: tuple[float, ...], rate_hz: float) -> tuple[float, ...]:
    """Return taps of 1 kHz for another rate, k kHz, with the same gain and minimum phase.

    The filter lasts as long, with k times as many taps. Above 500 Hz it keeps the gain of 500 Hz.
    """
    several = round(rate_hz / RATE_HZ)
    if several == 1 or len(taps) == 1:
        return taps
    gain = np.abs(np.fft.rfft(taps, 4 * _SEGMENT))
    wanted = np.concatenate([gain, np.full((several - 1) * 2 * _SEGMENT, gain[-1])])
    return tuple(_minimum_phase(wanted)[: several * len(taps)].tolist())


def sweep(amplitude_v: float, low_hz: float, high_hz: float, duration_s: float) -> FloatArray:
    """Return an exponential sweep at 1 kHz, shape (n,), V, faded in and out over 50 ms.

    Raises
    ------
    InputError
        The band is not within 0 and 500 Hz, or the sweep is shorter than 1 s.
    """
    if not (0.0 < low_hz < high_hz <= RATE_HZ / 2.0 and duration_s >= 1.0):
        raise InputError(
            f"a sweep from {low_hz:g} to {high_hz:g} Hz in {duration_s:g} s: allowed are "
            "rising frequencies above 0 to 500 Hz, and 1 s or more"
        )
    times = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    growth = np.log(high_hz / low_hz)
    phase = 2.0 * np.pi * low_hz * duration_s / growth * np.expm1(growth * times / duration_s)
    fade = np.clip(np.minimum(times, times[::-1]) / 0.05, 0.0, 1.0)
    signal: FloatArray = amplitude_v * fade * np.sin(phase)
    return signal


def fit_equaliser(
    volts: FloatArray,
    acceleration_m_s2: FloatArray,
    *,
    low_hz: float | None = None,
    high_hz: float = 450.0,
    largest_gain_db: float = 12.0,
) -> Equaliser:
    """Fit level and equaliser to the acceleration that a voltage caused.

    Parameters
    ----------
    volts, acceleration_m_s2
        Shape (n,) each, at 1 kHz, begun within 0.2 s of each other.
    low_hz, high_hz
        The band that is equalised; outside it the gain of its edges is kept. Without `low_hz` the
        band starts at the lowest frequency that the largest gain raises to the level and at which
        the coherence is high: the actuator decides, not a data sheet.
    largest_gain_db
        Largest gain and largest attenuation at any frequency.

    Raises
    ------
    InputError
        The signals are too short, of different lengths, or have too little coherence.
    """
    first_hz = _PROVISIONAL_HZ if low_hz is None else low_hz
    band = _check(volts, acceleration_m_s2, first_hz, high_hz, largest_gain_db)
    transfer, coherence, driven = _transfer(*_align(volts, acceleration_m_s2))
    bound = 10.0 ** (largest_gain_db / 20.0)
    smooth = _smooth(np.abs(transfer) ** 2) ** 0.5
    if low_hz is None:
        obeys = driven & (coherence > _LEAST_COHERENCE)
        obeys &= smooth * bound >= np.sqrt(np.mean(smooth[band] ** 2))
        lowest = int(np.flatnonzero(band)[0])
        while lowest > 1 and obeys[lowest - 1]:
            lowest -= 1
        band[lowest:] |= _FREQUENCIES_HZ[lowest:] < first_hz
    explained = float(np.median(coherence[band]))
    if not explained >= _LEAST_COHERENCE:
        raise InputError(
            f"the voltage explains {100.0 * explained:.0f} % of the measured acceleration, it must "
            f"be {100.0 * _LEAST_COHERENCE:.0f} %: raise the level, keep the handle still, and "
            "check that both are recorded at 1 kHz by one clock"
        )
    level = float(np.sqrt(np.mean(np.abs(transfer[band]) ** 2)))
    relative = smooth / level
    wanted = np.clip(1.0 / np.maximum(relative, 1e-9), 1.0 / bound, bound)
    inside = np.flatnonzero(band)
    wanted[: inside[0]] = wanted[inside[0]]
    wanted[inside[-1] :] = wanted[inside[-1]]
    taps = _minimum_phase(wanted)[:TAPS]
    taps[-_FADE:] *= 0.5 + 0.5 * np.cos(np.pi * np.arange(1, _FADE + 1) / (_FADE + 1))
    gain = np.abs(np.fft.rfft(taps, 4 * _SEGMENT))
    if gain.max() > bound:  # cutting the filter short has let its gain overshoot
        taps = taps * (bound / gain.max())
    evened = np.abs(np.fft.rfft(taps, _SEGMENT))[band] * np.abs(transfer[band])
    level_evened = float(np.sqrt(np.mean(evened**2)))
    return Equaliser(
        volts_per_m_s2=1.0 / level_evened,
        taps=tuple(taps.tolist()),
        unevenness_db=float(np.std(20.0 * np.log10(np.abs(transfer[band])))),
        remaining_db=float(np.std(20.0 * np.log10(evened))),
        coherence=explained,
        low_hz=float(_FREQUENCIES_HZ[band][0]),
        response_hz=tuple(_FREQUENCIES_HZ[driven].tolist()),
        response=tuple(smooth[driven].tolist()),
    )


def _check(
    volts: FloatArray,
    acceleration: FloatArray,
    low_hz: float,
    high_hz: float,
    largest_gain_db: float,
) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
    """Check the arguments, and return a mask of the frequencies in the band."""
    least = (_LEAST_SEGMENTS + 1) * _SEGMENT // 2 + _LONGEST_SHIFT
    if volts.ndim != 1 or volts.shape != acceleration.shape or len(volts) < least:
        raise InputError(
            f"voltage {volts.shape} and acceleration {acceleration.shape} must be of one length, "
            f"at least {least} samples"
        )
    if not (np.all(np.isfinite(volts)) and np.all(np.isfinite(acceleration))):
        raise InputError("voltage and acceleration must be finite numbers")
    if not (volts.any() and acceleration.any()):
        raise InputError("voltage or acceleration is zero throughout: check what was recorded")
    band = (low_hz <= _FREQUENCIES_HZ) & (high_hz >= _FREQUENCIES_HZ)
    if np.count_nonzero(band) < 4 or not 0.0 < largest_gain_db <= 40.0:
        raise InputError(
            f"band {low_hz:g} to {high_hz:g} Hz and {largest_gain_db:g} dB: allowed are at least "
            "20 Hz below 500 Hz, and above 0 to 40 dB"
        )
    return band


def _align(volts: FloatArray, acceleration: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cut both signals so that the acceleration is aligned with the voltage."""
    size = 2 * len(volts)
    product = np.fft.rfft(acceleration, size) * np.conj(np.fft.rfft(volts, size))
    correlation = np.abs(np.fft.irfft(product, size))
    shifts = np.arange(-_LONGEST_SHIFT, _LONGEST_SHIFT + 1)
    shift = int(shifts[np.argmax(correlation[shifts])])
    if shift >= 0:
        return volts[: len(volts) - shift], acceleration[shift:]
    return volts[-shift:], acceleration[:shift]


def _transfer(
    volts: FloatArray, acceleration: FloatArray
) -> "tuple[Spectrum, FloatArray, np.ndarray[tuple[int], np.dtype[np.bool_]]]":
    """Return transfer, coherence and a mask of the driven frequencies, from Hann windows."""
    starts = np.arange(0, len(volts) - _SEGMENT + 1, _SEGMENT // 2)
    places = starts[:, np.newaxis] + np.arange(_SEGMENT)
    window = np.hanning(_SEGMENT)
    driven = np.fft.rfft(volts[places] * window, axis=1)
    response = np.fft.rfft(acceleration[places] * window, axis=1)
    power = np.mean(np.abs(driven) ** 2, axis=0)
    was_driven = power > _DRIVEN * power.max()
    power = np.maximum(power, max(1e-12 * power.max(), 1e-300))
    cross: Spectrum = np.mean(response * np.conj(driven), axis=0)
    loudness = np.maximum(np.mean(np.abs(response) ** 2, axis=0), 1e-300)
    return cross / power, np.abs(cross) ** 2 / (power * loudness), was_driven


def _smooth(values: FloatArray) -> FloatArray:
    width = 2 * _SMOOTHING + 1
    padded = np.pad(values, _SMOOTHING, mode="edge")
    smoothed: FloatArray = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
    return smoothed


def _minimum_phase(magnitude: FloatArray) -> FloatArray:
    """Return the taps of the minimum-phase filter of a magnitude."""
    cepstrum = np.fft.irfft(np.log(magnitude))
    half = len(cepstrum) // 2
    cepstrum[1:half] *= 2.0
    cepstrum[half + 1 :] = 0.0
    taps: FloatArray = np.fft.irfft(np.exp(np.fft.rfft(cepstrum)))
    return taps
