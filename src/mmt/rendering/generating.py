"""Samples at the device's rate from the newest estimate of the vibration's filter.

A model is valid at one rate, 1 kHz as a rule; sound cards take 44.1 or 48 kHz, other devices 2 kHz.
The filter that converts is a Kaiser-windowed sinc in polyphase form, 16 samples of the slower of
the two rates long, which delays by half of that. Below 0.39 of the slower rate it is flat within
0.05 dB, above 0.61 of it at least 53 dB down. Cost: 16 multiplications a sample, and for a slower
device more in proportion.
"""

from collections.abc import Iterable
from fractions import Fraction
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.synthesis.generation import Generator, VibrationFilter

_TAPS: Final = 16
_KAISER_BETA: Final = 5.4
_FINEST: Final = 100
"""Rates count in hundredths of a hertz."""
_LARGEST_FACTOR: Final = 100_000


class RateConverter:
    """Convert a stream from one sampling rate to another; the same for any size of blocks.

    Parameters
    ----------
    from_hz, to_hz
        The rates, positive; exact to a hundredth of a hertz.

    Raises
    ------
    InputError
        A rate is not positive and finite, or their ratio is no fraction of numbers below
        100,000.
    """

    def __init__(self, from_hz: float, to_hz: float) -> None:
        ratio = _exact(to_hz) / _exact(from_hz)
        self._up, self._down = ratio.numerator, ratio.denominator
        if max(self._up, self._down) > _LARGEST_FACTOR:
            raise InputError(
                f"from {from_hz:g} to {to_hz:g} Hz: the ratio is no simple fraction; choose "
                "a multiple of 1 Hz, or better of 100 Hz"
            )
        self.phases = _polyphase(self._up, self._down)
        self._reach = self.phases.shape[1]
        self.delay_s = float((self._up * self._reach - 1) / (2 * self._up * from_hz))
        """Delay of the filter, 0 if the rates are the same."""
        self._history = np.zeros(self._reach)
        self._taken = self._given = 0

    def needed(self, count: int) -> int:
        """Return how many samples must be put in before `count` more can be returned."""
        if count <= 0:
            return 0
        return max(0, (self._given + count - 1) * self._down // self._up + 1 - self._taken)

    def convert(self, samples: FloatArray, count: int | None = None) -> FloatArray:
        """Return the samples that follow from n more.

        Parameters
        ----------
        samples
            Shape (n,).
        count
            Number of samples to return; n must then be ``needed(count)``, and any further
            samples come next time. None returns all that there can be.
        """
        line = np.concatenate([self._history, samples])
        first = self._taken - len(self._history)  # the number of the line's first sample
        self._taken += len(samples)
        end = -(-self._taken * self._up // self._down) if count is None else self._given + count
        steps = np.arange(self._given, end) * self._down
        self._given = end
        self._history = line[len(line) - self._reach :].copy()
        if not len(steps):
            return np.zeros(0)
        windows = np.lib.stride_tricks.sliding_window_view(line, self._reach)
        oldest = steps // self._up - first - self._reach + 1
        output: FloatArray = np.einsum("ij,ij->i", windows[oldest], self.phases[steps % self._up])
        return output


def _exact(rate_hz: float) -> Fraction:
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise InputError(f"a sampling rate of {rate_hz} Hz: it must be positive and finite")
    return Fraction(round(rate_hz * _FINEST), _FINEST)


def _polyphase(up: int, down: int) -> FloatArray:
    """Return the taps of each phase, the oldest sample's first; shape (up, taps)."""
    if up == down:
        return np.ones((1, 1))
    slower = max(1.0, down / up)  # in samples of the first rate
    taps = int(np.ceil(_TAPS * slower))
    cutoff = 1.0 / max(up, down)
    offsets = np.arange(up * taps) - (up * taps - 1) / 2
    # as scipy.signal.firwin, which takes as long to import as a player's whole start
    prototype = np.sinc(cutoff * offsets) * np.kaiser(up * taps, _KAISER_BETA)
    phases = prototype.reshape(taps, up).T
    normalised: FloatArray = (phases / phases.sum(axis=1, keepdims=True))[:, ::-1]
    return np.ascontiguousarray(normalised)


class OutputGenerator:
    """Generate at the rates of the models, convert each to the device's, and add them up.

    Each rate has one filter at a time, whose memory is carried over from estimate to estimate.
    Rates other than that of the newest estimate decay to silence.

    Parameters
    ----------
    rates_hz
        Sampling rates of the models.
    output_hz
        Sampling rate of the device.
    seed
        Seed of the excitation.
    limit_m_s2
        Bound of the output.

    Raises
    ------
    InputError
        Rates are not positive, or have no simple ratio.
    """

    def __init__(
        self, rates_hz: Iterable[float], output_hz: float, *, seed: int, limit_m_s2: float
    ) -> None:
        self._limit_m_s2 = limit_m_s2
        self._lanes = {
            rate_hz: (
                Generator(seed=seed, rate_hz=rate_hz, limit_m_s2=limit_m_s2),
                RateConverter(rate_hz, output_hz),
            )
            for rate_hz in sorted(set(rates_hz))
        }

    def set_estimate(self, estimate: VibrationFilter | None) -> None:
        """Use another estimate; None decays to silence."""
        for rate_hz, (generator, _) in self._lanes.items():
            wanted = estimate is not None and estimate.rate_hz == rate_hz
            generator.set_filter(estimate if wanted else None)

    def generate(self, count: int) -> FloatArray:
        """Return the next samples in m/s2, shape (count,)."""
        output = np.zeros(count)
        for generator, converter in self._lanes.values():
            output += converter.convert(generator.generate(converter.needed(count)), count)
        # the converter overshoots, and two rates may sound at once
        return np.clip(output, -self._limit_m_s2, self._limit_m_s2)
