"""The vibration of a whole motion over a texture, as an array or as a sound file."""

import io
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy.io import wavfile

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.files.existing import write_file
from mmt.rendering.calls import close, open_textures, render, touch
from mmt.texture.model.texture_model import TextureModel

_ESTIMATE_HZ: Final = 100.0


def effect(
    model: TextureModel,
    velocity_mm_s: FloatArray,
    force_n: FloatArray,
    *,
    motion_hz: float,
    output_hz: float,
    seed: int = 0,
) -> FloatArray:
    """Render the vibration of a motion (m/s2, shape (k,)), as `open_textures` does in real time.

    Parameters
    ----------
    model
        The texture.
    velocity_mm_s
        Velocity of the tool over the surface, shape (n, 2).
    force_n
        Force along its normal, shape (n,).
    motion_hz
        Sampling rate of velocity and force.
    output_hz
        Rate of the result.
    seed
        Seed of the excitation.

    Raises
    ------
    InputError
        The shapes disagree, or a rate is not positive.
    """
    if velocity_mm_s.shape != (len(force_n), 2):
        raise InputError(f"velocity has shape {velocity_mm_s.shape}, ({len(force_n)}, 2) needed")
    if not 0.0 < motion_hz < float("inf"):
        raise InputError(f"motion_hz is {motion_hz}: it must be positive and finite")
    textures = open_textures([model], output_hz=output_hz, estimate_hz=_ESTIMATE_HZ, seed=seed)
    seconds = len(force_n) / motion_hz
    steps = int(np.ceil(seconds * _ESTIMATE_HZ))
    bounds = np.round(np.arange(steps + 1) * output_hz / _ESTIMATE_HZ).astype(int)
    bounds = np.minimum(bounds, round(seconds * output_hz))
    blocks = [np.zeros(0)]
    for step in range(steps):
        moment = min(int(step * motion_hz / _ESTIMATE_HZ), len(force_n) - 1)
        x_mm_s, y_mm_s = velocity_mm_s[moment]
        touch(textures, 0, x_mm_s, y_mm_s, force_n[moment])
        blocks.append(render(textures, bounds[step + 1] - bounds[step]))
    close(textures)
    return np.concatenate(blocks)


class EffectFile(NamedTuple):
    """Duration and full scale of a written file."""

    seconds: float
    full_scale_m_s2: float
    """The acceleration that the file's largest number stands for."""


def write_wav(
    path: Path | str, samples_m_s2: FloatArray, rate_hz: int, full_scale_m_s2: float | None = None
) -> EffectFile:
    """Write vibration as a sound file with 16-bit samples.

    Parameters
    ----------
    path
        The file; replaced if it exists.
    samples_m_s2
        Shape (n,), finite.
    rate_hz
        Sampling rate.
    full_scale_m_s2
        Acceleration that the largest number stands for; larger samples are clipped. By default
        the largest sample, so that none is clipped.

    Raises
    ------
    InputError
        The file cannot be written, or the full scale is not positive.
    """
    largest = float(np.abs(samples_m_s2).max(initial=0.0))
    full_scale = checked_full_scale(full_scale_m_s2, largest)
    scaled = np.clip(samples_m_s2 / full_scale, -1.0, 1.0)
    sound = io.BytesIO()
    wavfile.write(sound, rate_hz, np.round(scaled * 32767.0).astype(np.int16))
    write_file(Path(path), sound.getvalue())
    return EffectFile(len(samples_m_s2) / rate_hz, full_scale)


def checked_full_scale(full_scale_m_s2: float | None, largest_m_s2: float) -> float:
    """Return the full scale of a file: the given one, or if None the largest value.

    Raises
    ------
    InputError
        The given full scale is not positive and finite.
    """
    full_scale = (largest_m_s2 or 1.0) if full_scale_m_s2 is None else full_scale_m_s2
    if not (np.isfinite(full_scale) and full_scale > 0):
        raise InputError(f"a full scale of {full_scale} m/s2: it must be positive and finite")
    return float(full_scale)
