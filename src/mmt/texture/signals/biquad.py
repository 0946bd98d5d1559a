"""Second-order filters: closed-form designs and one-sample stepping in plain Python.

The two designs that the project needs (a Bessel low-pass for motion and force, a
Butterworth high-pass for acceleration) have closed forms. They stand here because the
design functions of scipy.signal would cost every service 42 MB and 0.4 s at its start.
This module imports neither numba nor scipy, so that a leader which only streams
vibration stays free of both.

Stability: the bilinear transform maps stable analogue poles to stable digital ones at
every allowed cutoff. Cutoffs under 1e-4 of the rate are refused: there the coefficients
differ from those of a double integrator by less than 1e-7 and lose the digits of the gain.
"""

import cmath
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError

MOTION_CUTOFF_HZ: Final = 20.0
"""The published cutoff of the low-pass of motion and force."""

VIBRATION_CUTOFF_HZ: Final = 10.0
"""The published corner of the high-pass of the acceleration."""

SMALLEST = 1e-30
"""States below this become zero, before they turn into slow denormal numbers."""

LARGEST = 1e100
"""Inputs beyond this, and those that are not finite, are not measurements."""

_LOWEST_SHARE = 1e-4
_HIGHEST_SHARE = 0.4999

_BESSEL_3_DB = math.sqrt((math.sqrt(45.0) - 3.0) / 2.0)
"""Frequency at which 3 / (s^2 + 3 s + 3) has fallen by 3 dB: the root of w^4 + 3 w^2 = 9."""


@dataclass(frozen=True, slots=True)
class Biquad:
    """A second-order section (b0 + b1/z + b2/z^2) / (1 + a1/z + a2/z^2) at a rate."""

    b0: float
    b1: float
    b2: float
    a1: float
    a2: float
    rate_hz: float

    def gain_at(self, frequencies_hz: FloatArray) -> FloatArray:
        """Return the magnitude of the gain at frequencies (f,), shape (f,)."""
        back = np.exp(-2j * np.pi * frequencies_hz / self.rate_hz)
        numerator = self.b0 + (self.b1 + self.b2 * back) * back
        return np.asarray(np.abs(numerator / (1.0 + (self.a1 + self.a2 * back) * back)))

    def delay_samples(self, at_hz: float) -> float:
        """Return the group delay in samples at a frequency at which the gain is not zero.

        For a polynomial P(z) = sum p_k z^-k the delay is Re(sum k p_k z^-k / P(z)); that
        of the section is the numerator's less the denominator's.
        """
        back = cmath.exp(-2j * math.pi * at_hz / self.rate_hz)
        numerator = (self.b1 + 2.0 * self.b2 * back) / (self.b0 + (self.b1 + self.b2 * back) * back)
        denominator = (self.a1 + 2.0 * self.a2 * back) / (1.0 + (self.a1 + self.a2 * back) * back)
        return ((numerator - denominator) * back).real

    def settling_samples(self, share: float) -> int:
        """Return after how many samples the slowest mode has decayed to a share (0 to 1)."""
        root = cmath.sqrt(self.a1 * self.a1 - 4.0 * self.a2)
        radius = max(abs(-self.a1 + root), abs(-self.a1 - root)) / 2.0
        return 0 if radius == 0.0 else math.ceil(math.log(share) / math.log(radius))

    def steady_state(self, value: float) -> tuple[float, float]:
        """Return both states (transposed direct form II) after a constant input for ever."""
        output = (self.b0 + self.b1 + self.b2) / (1.0 + self.a1 + self.a2) * value
        second = self.b2 * value - self.a2 * output
        return self.b1 * value - self.a1 * output + second, second


def bessel_low_pass(cutoff_hz: float, rate_hz: float) -> Biquad:
    """Design a second-order Bessel low-pass, -3 dB at the cutoff.

    The prototype 3 / (s^2 + 3 s + 3) is scaled to -3 dB at the cutoff and mapped by the
    bilinear transform with prewarping: `scipy.signal.bessel(2, cutoff, fs=rate,
    norm='mag')`. Its delay at low frequencies is nearly constant.

    Raises
    ------
    InputError
        The cutoff is not between 1e-4 and 0.4999 of the rate.
    """
    quadratic, linear = _BESSEL_3_DB * _BESSEL_3_DB, 3.0 * _BESSEL_3_DB
    return _bilinear((0.0, 3.0), (quadratic, linear, 3.0), cutoff_hz, rate_hz)


def butterworth_high_pass(cutoff_hz: float, rate_hz: float) -> Biquad:
    """Design a second-order Butterworth high-pass, -3 dB at the cutoff.

    The prototype s^2 / (s^2 + sqrt(2) s + 1), mapped by the bilinear transform with
    prewarping: `scipy.signal.butter(2, cutoff, 'highpass', fs=rate)`.

    Raises
    ------
    InputError
        The cutoff is not between 1e-4 and 0.4999 of the rate.
    """
    return _bilinear((1.0, 0.0), (1.0, math.sqrt(2.0), 1.0), cutoff_hz, rate_hz)


class BiquadFilter:
    """Filter one channel sample by sample, in plain Python (about 0.4 us a sample).

    It filters the streamed vibration, which must not be delayed: one instance for each
    axis. The first sample puts the filter into the steady state of a constant input, so
    that a high-pass starts at zero and not with gravity's step.

    A number that is not finite, or is beyond `LARGEST`, repeats the previous input; before
    the first good sample it gives 0.
    """

    __slots__ = ("_biquad", "_first", "_held", "_second", "_started")

    def __init__(self, biquad: Biquad) -> None:
        self._biquad = biquad
        self.reset()

    def reset(self) -> None:
        """Reset the state: the next sample starts in its own steady state."""
        self._started = False
        self._held = 0.0
        self._first = 0.0
        self._second = 0.0

    def step(self, value: float) -> float:
        """Filter one sample."""
        return self.steps((value,))[0]

    def steps(self, values: Iterable[float]) -> list[float]:
        """Filter the next samples."""
        section, filtered = self._biquad, []
        for given in values:
            value = float(given)  # a float32 scalar would pull the states down to its precision
            if not -LARGEST <= value <= LARGEST:
                if not self._started:
                    filtered.append(0.0)
                    continue
                value = self._held
            elif not self._started:
                self._started = True
                self._first, self._second = section.steady_state(value)
            self._held = value
            output = section.b0 * value + self._first
            first = section.b1 * value - section.a1 * output + self._second
            second = section.b2 * value - section.a2 * output
            self._first = first if first > SMALLEST or first < -SMALLEST else 0.0
            self._second = second if second > SMALLEST or second < -SMALLEST else 0.0
            filtered.append(output)
        return filtered


def _bilinear(
    top: tuple[float, float],
    bottom: tuple[float, float, float],
    cutoff_hz: float,
    rate_hz: float,
) -> Biquad:
    """Map ``(t2 s^2 + t0) / (c2 s^2 + c1 s + c0)`` with cutoff 1, prewarped, to a rate."""
    lowest, highest = _LOWEST_SHARE * rate_hz, _HIGHEST_SHARE * rate_hz
    if not (math.isfinite(rate_hz) and rate_hz > 0.0 and lowest <= cutoff_hz <= highest):
        raise InputError(
            f"filter cutoff {cutoff_hz} Hz at {rate_hz} Hz: allowed are 1e-4 to 0.4999 of a "
            "positive rate"
        )
    warped = math.tan(math.pi * cutoff_hz / rate_hz)
    constant, linear = bottom[2] * warped * warped, bottom[1] * warped
    scale = 1.0 / (bottom[0] + linear + constant)
    square, rest = top[0] * scale, top[1] * warped * warped * scale
    return Biquad(
        b0=square + rest,
        b1=2.0 * (rest - square),
        b2=square + rest,
        a1=2.0 * (constant - bottom[0]) * scale,
        a2=(bottom[0] - linear + constant) * scale,
        rate_hz=rate_hz,
    )
