"""Base class of the Haptuator drivers: from m/s2 or volts to bounded voltages, and counts."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Final

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.guards import SampleGuard
from mmt.devices.haptuator.drive import FADE_S, VoltageDrive
from mmt.devices.haptuator.equaliser import ActuatorLevel
from mmt.devices.haptuator.options import HaptuatorOptions
from mmt.devices.protocols import USUAL_RATE_HZ

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
