"""The acceleration of a session as sound, with its full scale and date in the file."""

import io
import json
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.files.existing import replacing
from mmt.core.frames import FRAMES_HZ, acceleration_samples
from mmt.session.data import RecordedSession

_LARGEST_BYTES: Final = 1 << 32
"""A ``.wav`` stores its length in 32 bits."""
_BYTES: Final = 3 * 4


def write_wav(path: Path, session: RecordedSession) -> None:
    """Write the acceleration, x y z as three channels in single precision.

    1.0 is the full scale: the power of two (m/s2) at or above the largest value, so that scaling
    does not round. The comment (``ICMT``) is a JSON object with ``full_scale_m_s2`` and, if known,
    ``began_utc_ns``. Sound has no gaps: the last sample is repeated for missing frames.

    Raises
    ------
    InputError
        The session has no acceleration or is too long, scipy is not installed, or see
        `mmt.session.files.export_session`.
    MmtError
        Writing failed.
    """
    require("scipy")
    from scipy.io import wavfile

    if "acceleration" not in session.channels:
        raise InputError(f"session {path}: sound is made of acceleration, and there is none")
    several, frames = session.samples_per_frame, session.frames
    steps = np.ones(len(frames), dtype=np.int64)
    steps[:-1] = np.maximum(np.diff(frames["sequence"].astype(np.int64)), 1)  # 1 after a restart
    if steps.sum() * several * _BYTES >= _LARGEST_BYTES:
        raise InputError(f"session {path}: it is longer than the 4 GiB of a .wav; write an .h5")
    samples = acceleration_samples(frames)
    largest = np.abs(samples[np.isfinite(samples)]).max(initial=0.0)
    full_scale = float(2.0 ** np.ceil(np.log2(largest))) if largest > 0.0 else 1.0
    held = np.ones(len(samples), dtype=np.int64)
    held[several - 1 :: several] += several * (steps - 1)
    told: dict[str, Any] = {"full_scale_m_s2": full_scale}
    if session.began_utc_ns is not None:
        told["began_utc_ns"] = session.began_utc_ns
    sound = io.BytesIO()
    wavfile.write(sound, FRAMES_HZ * several, np.repeat(samples / full_scale, held, axis=0))
    text = json.dumps(told).encode() + b"\0"
    text += b"\0" * (len(text) % 2)
    sound.seek(0, io.SEEK_END)
    sound.write(b"LIST" + struct.pack("<I", 12 + len(text)) + b"INFO")
    sound.write(b"ICMT" + struct.pack("<I", len(text)) + text)
    size = sound.tell() - 8
    sound.seek(4)
    sound.write(struct.pack("<I", size))
    with replacing(path) as part:
        part.write_bytes(sound.getbuffer())


def read_comment(path: Path) -> dict[str, Any]:
    """Return the comment of a ``.wav`` by `write_wav` as a dict; {} for other files."""
    with path.open("rb") as stream:
        stream.seek(12)
        while len(head := stream.read(8)) == 8:
            name, size = struct.unpack("<4sI", head)
            end = stream.tell() + size + size % 2
            if name == b"LIST" and stream.read(8)[4:] == b"ICMT":
                try:
                    told = json.loads(stream.read(size - 8)[4:].rstrip(b"\0"))
                except ValueError:
                    return {}
                return told if isinstance(told, dict) else {}
            stream.seek(end)
    return {}
