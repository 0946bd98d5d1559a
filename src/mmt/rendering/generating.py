"""Samples at the device's rate from the newest estimate of the vibration's filter."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.rendering.rate import RateConverter
from mmt.texture.synthesis.generation import Generator, VibrationFilter


@dataclass(frozen=True, eq=False)
class Estimate:
    """Filter by which to generate, and the sampling rate that it is valid at."""

    filter: VibrationFilter
    rate_hz: float


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
        Bound of each rate's samples.

    Raises
    ------
    InputError
        Rates are not positive, or have no simple ratio.
    """

    def __init__(
        self, rates_hz: Iterable[float], output_hz: float, *, seed: int, limit_m_s2: float
    ) -> None:
        self._lanes = {
            rate_hz: (
                Generator(seed=seed, rate_hz=rate_hz, limit_m_s2=limit_m_s2),
                RateConverter(rate_hz, output_hz),
            )
            for rate_hz in sorted(set(rates_hz))
        }

    def set_estimate(self, estimate: Estimate | None) -> None:
        """Use another estimate; None decays to silence."""
        for rate_hz, (generator, _) in self._lanes.items():
            wanted = estimate is not None and estimate.rate_hz == rate_hz
            generator.set_filter(estimate.filter if wanted and estimate is not None else None)

    def generate(self, count: int) -> FloatArray:
        """Return the next samples in m/s2, shape (count,)."""
        output = np.zeros(count)
        for generator, converter in self._lanes.values():
            output += converter.convert(generator.generate(converter.needed(count)), count)
        return output
