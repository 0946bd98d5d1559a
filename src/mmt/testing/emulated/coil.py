"""The coil of an emulated Haptuator: a mass on a spring, and the sweep that calibrates it."""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.devices.haptuator.equaliser import RATE_HZ, ActuatorLevel, fit_equaliser, sweep

RESONANCE_HZ: Final = 60.0
DAMPING_RATIO: Final = 0.2
LEVEL_M_S2_PER_V: Final = 15.0
"""Above the resonance; all three are our choice, of the order of a small voice coil."""
_SWEEP_S: Final = 8.0
_SWEPT_HZ: Final = (20.0, 490.0)
_RINGING_S: Final = 0.5
"""After this the coil is at rest to the last digit."""


def coil_acceleration_m_s2(volts: FloatArray, rate_hz: float) -> FloatArray:
    """Return the handle's acceleration (n,) for voltages (n,), by the bilinear transform."""
    size = len(volts) + round(_RINGING_S * rate_hz)
    s = 2j * rate_hz * np.tan(np.pi * np.fft.rfftfreq(size)) / (2.0 * np.pi * RESONANCE_HZ)
    transfer = LEVEL_M_S2_PER_V * s**2 / (s**2 + 2.0 * DAMPING_RATIO * s + 1.0)
    return np.asarray(np.fft.irfft(np.fft.rfft(volts, size) * transfer, size)[: len(volts)])


def swept_level() -> ActuatorLevel:
    """Return the level that `mmt device equalise` would store for this coil."""
    volts = sweep(1.0, *_SWEPT_HZ, _SWEEP_S)
    return fit_equaliser(volts, coil_acceleration_m_s2(volts, RATE_HZ))
