"""Tell how much of an imported acceleration will be modelled."""

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.frames import acceleration_samples, samples_per_frame
from mmt.session.importing.resampling import RATE_HZ
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.biquad import VIBRATION_CUTOFF_HZ

_LEAST_POWER = 1e-12
"""Power, in (m/s2)^2, below which the signal is only the rounding of a constant."""


def modelled_sentence(frames: RecordArray, source_hz: float) -> str:
    """Return a sentence on the axis modelled by default, and the power of the others.

    ``source_hz`` is the acceleration's rate before resampling. "" for frames (n,) without
    vibration.
    """
    if "acceleration_m_s2" not in (frames.dtype.names or ()) or len(frames) < RATE_HZ:
        return ""
    rate_hz = RATE_HZ * samples_per_frame(frames.dtype)
    acceleration = acceleration_samples(frames).astype(np.float64)
    count = len(acceleration)
    spectrum = np.fft.rfft(acceleration - acceleration.mean(axis=0), axis=0) / count
    vibrates = np.fft.rfftfreq(count, 1 / rate_hz) > VIBRATION_CUTOFF_HZ
    power = 2.0 * np.sum(np.abs(spectrum[vibrates]) ** 2, axis=0)
    if not np.isfinite(power).all() or power.sum() < _LEAST_POWER:
        return ""
    axis = ModellingSettings().axis
    share = 1.0 - power["xyz".index(axis)] / power.sum()
    others = " and ".join(other for other in "xyz" if other != axis)
    kept = f"; kept to {rate_hz / 2:.0f} Hz" if source_hz > 1.05 * rate_hz else ""
    return (
        f"modelled: acceleration {axis}; {others} hold {100.0 * share:.0f} % of the power "
        f'and are left out (axis = "dft321" in [texture] joins all three){kept}'
    )
