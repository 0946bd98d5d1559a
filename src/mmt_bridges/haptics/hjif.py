"""Vibration as an MPEG haptics file: the interchange format (.hjif) of ISO/IEC 23090-31.

The file holds the waveform itself, in one wavelet band. The standard's other kinds of band hold
keyframes, which need fifty times the space for the same error, and which the binary form rounds to
8 bits. The how-to tells what the reference software renders from each kind.
"""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.existing_files import write_file
from mmt_bridges.haptics.effects import EffectFile, checked_full_scale
from mmt_bridges.haptics.wavelets import wavelet_streams

RATES_HZ: Final = (1000, 2000, 4000, 8000)
"""Sampling rates that give blocks of 2^n samples; the frequency limit of a band is 10 kHz."""

_TICKS_A_SECOND: Final = 1000
_BLOCK_TICKS: Final = 128
"""Default length of a packet of the binary form: the reference encoder accepts no other."""


def write_hjif(
    path: Path | str,
    samples_m_s2: FloatArray,
    rate_hz: int,
    full_scale_m_s2: float | None = None,
    *,
    description: str = "",
) -> EffectFile:
    """Write vibration for one actuator, as a wavelet band of the main profile, level 1.

    Parameters
    ----------
    path
        The file; replaced if it exists.
    samples_m_s2
        Shape (n,), finite, n at least 1.
    rate_hz
        Sampling rate, one of `RATES_HZ`.
    full_scale_m_s2
        Acceleration that an amplitude of 1 stands for; larger samples are clipped. By default the
        largest sample. The file states it as the maximum amplitude of its device.
    description
        Description for people.

    Raises
    ------
    InputError
        The rate is not allowed, there are no samples, the full scale is not positive, or the file
        cannot be written.
    """
    if rate_hz not in RATES_HZ:
        allowed = ", ".join(map(str, RATES_HZ))
        raise InputError(f"{rate_hz} samples a second: .hjif can have {allowed}")
    if not len(samples_m_s2):
        raise InputError("no vibration to write: the motion is too short")
    full_scale = checked_full_scale(full_scale_m_s2, float(np.abs(samples_m_s2).max()))
    amplitude = np.clip(samples_m_s2 / full_scale, -1.0, 1.0)
    perception = {
        "id": 0,
        "avatar_id": 0,  # of no body model
        "description": description,
        "perception_modality": "Vibrotactile",
        "unit_exponent": -3,
        "perception_unit_exponent": 0,
        "reference_devices": [
            {"id": 1, "name": "full scale in m/s2", "maximum_amplitude": full_scale}
        ],
        "effect_library": [],
        "channels": [_channel(amplitude, rate_hz)],
    }
    document = {
        "version": "2023",
        "profile": "Main",
        "level": 1,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "description": description,
        "timescale": _TICKS_A_SECOND,
        "avatars": [],
        "perceptions": [perception],
        "syncs": [],
    }
    write_file(Path(path), json.dumps(document, separators=(",", ":"), allow_nan=False))
    return EffectFile(len(samples_m_s2) / rate_hz, full_scale)


def _channel(amplitude: FloatArray, rate_hz: int) -> dict[str, Any]:
    streams = wavelet_streams(amplitude, _BLOCK_TICKS * rate_hz // _TICKS_A_SECOND)
    band = {
        "band_type": "WaveletWave",
        "block_length": _BLOCK_TICKS,
        "lower_frequency_limit": 0,
        "upper_frequency_limit": rate_hz,  # for a wavelet band the sampling rate
        "effects": [
            {"effect_type": "Basis", "position": index * _BLOCK_TICKS, "wavelet_stream": stream}
            for index, stream in enumerate(streams)
        ],
    }
    return {
        "id": 0,
        "description": "vibration",
        "reference_device_id": 1,
        "gain": 1.0,
        "mixing_coefficient": 1.0,
        "body_part_mask": 0,
        "frequency_sampling": rate_hz,
        "sample_count": len(amplitude),
        "bands": [band],
    }
