"""The coil of an emulated Haptuator: a mass on a spring, and the sweep that calibrates it."""

from typing import Final

import numpy as np
from scipy import signal

from mmt.core.arrays import FloatArray
from mmt.devices.haptuator.drive import Level
from mmt.devices.haptuator.equaliser import RATE_HZ, fit_equaliser, sweep

RESONANCE_HZ: Final = 60.0
DAMPING_RATIO: Final = 0.2
LEVEL_M_S2_PER_V: Final = 15.0
"""Above the resonance; all three are our choice, of the order of a small voice coil."""
_SWEEP_S: Final = 8.0
_SWEPT_HZ: Final = (20.0, 490.0)


def coil_acceleration_m_s2(volts: FloatArray, rate_hz: float) -> FloatArray:
    """Return the acceleration of the handle that voltages (n,) make, (n,)."""
    rate = 2.0 * np.pi * RESONANCE_HZ
    b, a = signal.bilinear(
        [LEVEL_M_S2_PER_V, 0.0, 0.0], [1.0, 2.0 * DAMPING_RATIO * rate, rate * rate], rate_hz
    )
    return np.asarray(signal.lfilter(b, a, volts))


def swept_level() -> Level:
    """Return what `mmt device equalise` would have stored of this coil."""
    volts = sweep(1.0, *_SWEPT_HZ, _SWEEP_S)
    fitted = fit_equaliser(volts, coil_acceleration_m_s2(volts, RATE_HZ))
    return Level(
        fitted.volts_per_m_s2, fitted.taps, fitted.low_hz, fitted.response_hz, fitted.response
    )
