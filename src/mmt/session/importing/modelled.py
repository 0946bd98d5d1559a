"""What of an imported acceleration will be modelled, and what is left out."""

import numpy as np
from scipy import signal

from mmt.core.arrays import RecordArray
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.filtering import VIBRATION_CUTOFF_HZ

_LEAST_POWER = 1e-12
"""Power in (m/s2)^2 below which there is only the rounding of a constant."""


def modelled_sentence(frames: RecordArray, rate_hz: float, source_hz: float) -> str:
    """Say which axis of the frames (n,) is modelled by default, and what the others hold.

    ``source_hz`` is the rate of the acceleration before it was resampled to ``rate_hz``. "" for
    frames without vibration.
    """
    names = frames.dtype.names or ()
    settings = ModellingSettings()
    if "acceleration_m_s2" not in names or len(frames) < rate_hz or settings.axis == "dft321":
        return ""
    sections = signal.butter(2, VIBRATION_CUTOFF_HZ, "high", fs=rate_hz, output="sos")
    acceleration = frames["acceleration_m_s2"].astype(np.float64)
    vibration = signal.sosfilt(sections, acceleration - acceleration.mean(axis=0), axis=0)
    power = np.var(vibration[int(rate_hz / 2) :], axis=0)
    if not np.isfinite(power).all() or power.sum() < _LEAST_POWER:
        return ""
    share = 1.0 - power["xyz".index(settings.axis)] / power.sum()
    others = " and ".join(axis for axis in "xyz" if axis != settings.axis)
    kept = f"; kept to {rate_hz / 2:.0f} Hz" if source_hz > 1.05 * rate_hz else ""
    return (
        f"modelled: acceleration {settings.axis}; {others} hold {100.0 * share:.0f} % of the power "
        f'and are left out (axis = "dft321" in [texture] joins all three){kept}'
    )
