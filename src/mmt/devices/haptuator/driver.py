"""Base class of the Haptuator drivers: from m/s2 or volts to bounded voltages, and counts."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import TypeAdapter, ValidationError

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.guards import SampleGuard
from mmt.devices.calibrations import calibration_file, load_calibration, save_calibration
from mmt.devices.haptuator.equaliser import ActuatorLevel, Equaliser, taps_at
from mmt.devices.haptuator.options import HaptuatorOptions
from mmt.devices.leader_reports import ActuatorStatistics
from mmt.devices.protocols import USUAL_RATE_HZ
from mmt.texture.signals.biquad import BiquadFilter, bessel_low_pass, butterworth_high_pass

DEVICE: Final = "haptuator"
_STORED: Final = TypeAdapter(ActuatorLevel)


def level_of(options: HaptuatorOptions) -> ActuatorLevel:
    """Return the level of the options, or the one stored for their serial number.

    Raises
    ------
    InputError
        No usable calibration is stored.
    MmtError
        The calibration cannot be read.
    """
    if options.volts_per_m_s2 is not None:
        return ActuatorLevel(options.volts_per_m_s2, (1.0,))
    serial = options.serial or ""
    stored = load_calibration(DEVICE, serial)
    if stored is None:
        raise InputError(
            f"no calibration of Haptuator {serial} is stored: make one by 'mmt device equalise', "
            "or give 'volts_per_m_s2'"
        )
    try:
        return _STORED.validate_python(stored)
    except ValidationError as error:
        raise InputError(
            f"the calibration {calibration_file(DEVICE, serial)} is not that of a "
            "Haptuator: make it again by 'mmt device equalise'"
        ) from error


def store_level(equaliser: Equaliser, serial: str) -> Path:
    """Store the level and equaliser of a sweep; return the file.

    Raises
    ------
    MmtError
        The file cannot be written.
    """
    return save_calibration(DEVICE, serial, asdict(equaliser))


FADE_S: Final = 0.01
"""Time over which the output fades out at a voltage that is not finite, and in again."""
_HIGHEST_SHARE: Final = 0.4999
"""A low-pass above this share of the rate would pass everything."""


class VoltageDrive:
    """Band-limit samples, equalise them, scale them to volts, and limit the voltage.

    It takes some 2 us a sample, and 4 us a call for an equaliser. A sample that is not finite
    counts as clipped; the high-pass lets the output die away during such samples.

    Parameters
    ----------
    options
        Band, level and limits.
    rate_hz
        Sampling rate. A low-pass at or above half of it is left out.
    level
        Level and equaliser in place of those that the options name.

    Raises
    ------
    InputError
        No level is stored for the serial number.
    """

    def __init__(
        self, options: HaptuatorOptions, rate_hz: float, level: ActuatorLevel | None = None
    ) -> None:
        level = level or level_of(options)
        self._scale = level.volts_per_m_s2
        self._taps = taps_at(level.taps, rate_hz)
        self._guard = SampleGuard(options.largest_v, round(FADE_S * rate_hz))
        low_hz = level.low_hz if options.low_hz is None else options.low_hz
        sections = [butterworth_high_pass(low_hz, rate_hz)]
        if options.high_hz < _HIGHEST_SHARE * rate_hz:
            sections.append(bessel_low_pass(options.high_hz, rate_hz))
        self.low_hz = low_hz
        """Below this the actuator is not driven."""
        self._level, self._biquads, self._rate_hz = level, sections, rate_hz
        self._sections = [BiquadFilter(section) for section in sections]
        self._filters: tuple[Callable[[float], float], ...] = tuple(
            section.step for section in self._sections
        )
        self._samples = 0
        self._not_finite = 0
        self._sum_squares = 0.0
        self._peak = 0.0
        self.reset_filters()

    def reset_filters(self) -> None:
        """Reset the filters to zero, not to the steady state of the next sample."""
        for section in self._sections:
            section.reset()
            section.step(0.0)
        self._before: list[float] = [0.0] * (len(self._taps) - 1)

    def convert(self, samples_m_s2: Sequence[float] | FloatArray) -> list[float]:
        """Return the voltages (V) for samples (n,), m/s2."""
        values = samples_m_s2 if isinstance(samples_m_s2, Sequence) else samples_m_s2.tolist()
        filters = self._filters
        kept = []
        for value in values:
            if math.isfinite(value):
                self._peak = max(self._peak, abs(value))
            else:
                self._not_finite += 1
            wanted = value
            for step in filters:  # a value that is not finite repeats the filter's last input
                wanted = step(wanted)
            kept.append(wanted)
        volts = []
        for wanted in self._evened(kept):
            voltage = self._guard.step(wanted * self._scale)
            self._sum_squares += voltage * voltage
            volts.append(voltage)
        self._samples += len(values)
        return volts

    def _evened(self, values: list[float]) -> list[float]:
        """Return samples (n,) after the equaliser."""
        if self._taps == (1.0,) or not values:
            return values
        known = self._before + values
        self._before = known[len(values) :]
        evened: list[float] = np.convolve(known, self._taps, mode="valid").tolist()
        return evened

    def gain(self, frequencies_hz: FloatArray) -> FloatArray:
        """Return the acceleration at the handle over the wanted one, by frequency.

        The stored sweep gives the actuator's part. Without one only the filters' gain is returned.
        """
        unit = np.exp(-2j * np.pi * frequencies_hz / self._rate_hz)
        gain = np.abs(np.polyval(self._taps, unit))
        for each in self._biquads:
            gain = gain * each.gain_at(frequencies_hz)
        if self._level.response:
            known = np.interp(
                frequencies_hz, self._level.response_hz, self._level.response, left=0.0
            )
            gain = gain * known * self._scale
        return np.asarray(gain)

    @property
    def statistics(self) -> ActuatorStatistics:
        """Counts and levels; the RMS is that of the voltage, divided by the level."""
        rms_v = math.sqrt(self._sum_squares / self._samples) if self._samples else 0.0
        clipped = self._not_finite + self._guard.limited + self._guard.not_finite
        return ActuatorStatistics(self._samples, clipped, rms_v / self._scale, self._peak)


SILENCE_NS: Final = 500_000_000
"""A card that asks for nothing, or a board that reports nothing, for this long is lost."""

_SMOOTHING: Final = 0.02


class HaptuatorDriver(ABC):
    """A `VoltageActuator` that is `RateFollowing`; a subclass sends the voltages to the converter.

    Parameters
    ----------
    options
        Level, band and limits.
    output_rate_hz
        Rate of the converter; its samples pass `_guard` as the last step.
    level
        Level in place of the one that the options name.
    """

    def __init__(
        self, options: HaptuatorOptions, output_rate_hz: float, level: ActuatorLevel | None = None
    ) -> None:
        self._to_volts, self._level, self._output_rate_hz = options, level, output_rate_hz
        self._rate_hz = USUAL_RATE_HZ
        self._drive = VoltageDrive(options, self._rate_hz, level)
        self._guard = SampleGuard(options.largest_v, round(FADE_S * output_rate_hz))
        self._latency_s: float | None = None

    def set_rate(self, rate_hz: float) -> None:
        """Take the rate of the samples; see `RateFollowing`.

        Raises
        ------
        InputError
            The converter is slower.
        """
        if rate_hz > self._output_rate_hz:
            raise InputError(
                f"the converter plays {self._output_rate_hz:g} samples a second, the session's "
                f"acceleration_rate_hz is {rate_hz:g}: lower it, or raise the converter's rate"
            )
        self._rate_hz = rate_hz
        self._drive = VoltageDrive(self._to_volts, rate_hz, self._level)

    @abstractmethod
    def _check(self) -> None:
        """Raise `DeviceLost` if nothing can be played."""

    @abstractmethod
    def _play(self, volts: list[float]) -> None:
        """Play voltages (n,), V, at the samples' rate, after the earlier ones; never blocks."""

    def calibrate(self) -> None:  # noqa: B027 - nothing is missing
        """Do nothing: the actuator's level is an option."""

    def write(self, samples_m_s2: Sequence[float] | FloatArray) -> None:
        """Play samples (n,), m/s2; never blocks.

        Raises
        ------
        DeviceLost
            The card or board is gone, or takes no more samples.
        """
        self._check()
        self._play(self._drive.convert(samples_m_s2))

    def response(self, frequencies_hz: FloatArray) -> tuple[FloatArray, float]:
        """Return the gain from wanted to actual acceleration; see `RespondingActuator`."""
        return self._drive.gain(frequencies_hz), self._drive.low_hz

    @property
    def largest_v(self) -> float:
        """Largest voltage (V) that the actuator may get."""
        return self._to_volts.largest_v

    def write_volts(self, volts: Sequence[float] | FloatArray) -> None:
        """Play voltages (n,), V, cut to the limit but not filtered; see `VoltageActuator`.

        Raises
        ------
        DeviceLost
            See `write`.
        """
        self._check()
        self._play(self._to_volts.clip(volts))

    def _note_latency(self, latency_s: float) -> None:
        known = self._latency_s
        self._latency_s = latency_s if known is None else known + _SMOOTHING * (latency_s - known)

    @property
    def _latency_ms(self) -> float | None:
        """Running mean, or None before the first value."""
        return None if self._latency_s is None else round(1e3 * self._latency_s, 2)
