"""Rendered vibration as a WAV file."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.io import wavfile

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError


class SoundFile(NamedTuple):
    """What was written."""

    seconds: float
    full_scale_m_s2: float
    """The acceleration that the file's largest number stands for."""


def write_wav(
    path: Path | str, samples_m_s2: FloatArray, rate_hz: int, full_scale_m_s2: float | None = None
) -> SoundFile:
    """Write vibration as 16 bit samples.

    Parameters
    ----------
    path
        Replaced where it is there.
    samples_m_s2
        Shape (n,), finite.
    rate_hz
        Its sampling rate.
    full_scale_m_s2
        The acceleration that the largest number stands for, beyond which samples are clipped;
        by default the largest of the samples, so that nothing is.

    Raises
    ------
    InputError
        The file cannot be written, or the full scale is not positive.
    """
    path = Path(path)
    largest = float(np.abs(samples_m_s2).max(initial=0.0))
    full_scale = (largest or 1.0) if full_scale_m_s2 is None else full_scale_m_s2
    if not (np.isfinite(full_scale) and full_scale > 0):
        raise InputError(f"a full scale of {full_scale} m/s2: it must be positive and finite")
    scaled = np.clip(samples_m_s2 / full_scale, -1.0, 1.0)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        wavfile.write(path, rate_hz, np.round(scaled * 32767.0).astype(np.int16))
    except OSError as error:
        raise InputError(f"sound {path}: {error.strerror or error}") from error
    return SoundFile(len(samples_m_s2) / rate_hz, full_scale)
