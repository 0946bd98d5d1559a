"""Vibration as an MPEG haptics file: the interchange format (.hjif) of ISO/IEC 23090-31.

The file holds the waveform itself, in one wavelet band. The standard's other kinds of band hold
keyframes, which need fifty times the space for the same error, and which the binary form rounds to
8 bits. The how-to tells what the reference software renders from each kind.

The wavelets are the biorthogonal ones with 9 and 7 taps of A. Cohen, I. Daubechies, J.-C.
Feauveau, "Biorthogonal bases of compactly supported wavelets", Comm. Pure Appl. Math. 45, 1992.
"""

import base64
import json
import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.ndimage import correlate1d

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.files.existing import write_file
from mmt_bridges.haptics.effects import EffectFile, checked_full_scale
from mmt_bridges.haptics.spiht import MOST_PLANES, encode_block

RATES_HZ: Final = (1000, 2000, 4000, 8000)
"""Sampling rates that give blocks of 2^n samples; the frequency limit of a band is 10 kHz."""

_TICKS_A_SECOND: Final = 1000
_BLOCK_TICKS: Final = 128
"""Default length of a packet of the binary form: the reference encoder accepts no other."""

_LOW: Final = (
    0.852698679009404,
    0.377402855612654,
    -0.110624404418423,
    -0.023849465019380,
    0.037828455506995,
)
"""The symmetric low-pass filter, from its middle outwards."""

_HIGH: Final = (-0.788485616405665, 0.418092273222212, 0.040689417609559, -0.064538882628938)

_COARSEST: Final = 4  # coefficients of the coarsest band
_FINEST_STEP: Final = 2.0**-15  # of full scale, as in 16-bit sound
_SMALL_SCALE: Final = 128  # steps per unit, for a scale up to 127/128
_LARGE_SCALE: Final = 8  # steps per unit, for a scale from 1


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
    streams = _wavelet_streams(amplitude, _BLOCK_TICKS * rate_hz // _TICKS_A_SECOND)
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


def _wavelet_streams(samples: FloatArray, block: int) -> list[str]:
    """Return the coded blocks of a waveform, as text in base 64.

    Parameters
    ----------
    samples
        Within -1 and 1; shape (n,). The last block is filled up with zeros.
    block
        Samples of a block: a power of two, 16 to 1024.
    """
    count = -(-len(samples) // block)
    blocks = np.zeros((count, block))
    blocks.reshape(-1)[: len(samples)] = samples
    return [_stream(each) for each in transform(blocks)]


def transform(blocks: FloatArray) -> FloatArray:
    """Return the wavelet coefficients of blocks, coarsest band first; shape (m, n) as given.

    Each block is continued by its mirror image at both ends.
    """
    coefficients = np.array(blocks, float)
    width = blocks.shape[1]
    while width > _COARSEST:
        low = _filtered(coefficients[:, :width], _LOW)[:, ::2]
        high = _filtered(coefficients[:, :width], _HIGH)[:, 1::2]
        coefficients[:, :width] = np.concatenate([low, high], axis=1)
        width //= 2
    return coefficients


def _filtered(blocks: FloatArray, half: tuple[float, ...]) -> FloatArray:
    return np.asarray(correlate1d(blocks, [*half[:0:-1], *half], axis=1, mode="mirror"))


def _stream(coefficients: FloatArray) -> str:
    largest = float(np.abs(coefficients).max())
    planes, code, scale = _scaling(largest)
    if largest < scale * 2.0 ** (-1 - planes):
        return ""  # all would round to zero: silence
    most = (1 << planes) - 1
    values = np.clip(np.rint(coefficients / scale * 2.0**planes), -most, most).astype(np.int64)
    # Without the padding of base 64: the reference decoder takes it for bits.
    return base64.b64encode(encode_block(values, planes, code)).decode().rstrip("=")


def _scaling(largest: float) -> tuple[int, int, float]:
    """Return bit planes, the header's 8 bits for the scale, and the scale, at least `largest`."""
    if largest <= 1.0 - 1.0 / _SMALL_SCALE:
        steps = max(1, math.ceil(largest * _SMALL_SCALE))
        code, scale = steps << 1, steps / _SMALL_SCALE
    else:
        steps = min(max(0, math.ceil((largest - 1.0) * _LARGE_SCALE)), 127)
        code, scale = steps << 1 | 1, 1.0 + steps / _LARGE_SCALE
    planes = math.ceil(math.log2(scale / _FINEST_STEP))
    return min(planes, MOST_PLANES), code, scale
