"""Export sessions as text, NumPy archives, Parquet, HDF5, MATLAB and sound files.

Data stored beside the frames has the same name in every format that can hold it.
"""

import io
import json
import struct
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.files.existing import replacing
from mmt.core.files.untrusted import json_object
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL, FRAMES_HZ, acceleration_samples
from mmt.core.units import QUANTITIES
from mmt.session.data import RecordedSession, to_json

_UNITS: Final = {
    "time_s": "s",
    "time_ns": "ns",
    "acceleration_time_s": "s",
    **{FIELD_OF_CHANNEL[c]: QUANTITIES[c].partition(",")[0] for c in CHANNELS},
}


def write_csv(path: Path, session: RecordedSession) -> None:
    """Write the frames, single-precision values with nine digits.

    The date of the first frame, if known, is the same in each row of the column ``began_utc_ns``:
    a CSV file has no other place for it that every reader accepts.

    Raises
    ------
    InputError, MmtError
        See `mmt.session.files.export_session`.
    """
    columns, began_ns = session.columns(), session.began_utc_ns
    formats = [
        "%d" if values.dtype.kind in "iu" else "%.9f" if name == "time_s" else "%.9g"
        for name, values in columns.items()
    ]
    table = np.column_stack([values.astype(np.float64) for values in columns.values()])
    header, row = ",".join(columns), ",".join(formats)
    if began_ns is not None:
        header, row = f"{header},began_utc_ns", f"{row},{began_ns}"
    with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as stream:
        np.savetxt(stream, table, fmt=row, header=header, comments="")


def write_npz(path: Path, session: RecordedSession) -> None:
    """Write frames, scene, annotations, events and the date.

    Raises
    ------
    InputError, MmtError
        See `mmt.session.files.export_session`.
    """
    with replacing(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, **_arrays(session))


def write_mat(path: Path, session: RecordedSession) -> None:
    """Write the arrays of `write_npz` as variables of a MATLAB file (version 5), 1-D as columns.

    Raises
    ------
    InputError
        scipy is not installed, or see `mmt.session.files.export_session`.
    MmtError
        Writing failed.
    """
    require("scipy")
    from scipy.io import savemat

    with replacing(path) as part, part.open("wb") as stream:
        savemat(stream, _arrays(session), do_compression=True, oned_as="column")


def _arrays(session: RecordedSession) -> dict[str, Any]:
    """Return frames, scene, annotations, events and date as arrays; scene and events as JSON."""
    arrays: dict[str, Any] = {"sequence": session.frames["sequence"], "time_s": session.time_s}
    arrays |= session.vectors()
    arrays |= {f"{name}_json": np.array(text) for name, text in _texts(session).items()}
    if session.annotations:
        arrays["annotations"] = np.frombuffer(session.annotations, dtype=np.uint8)
    if session.began_utc_ns is not None:
        arrays["began_utc_ns"] = np.int64(session.began_utc_ns)
    return arrays


def _texts(session: RecordedSession) -> dict[str, str]:
    """Return scene and events as JSON, as far as the session has them."""
    scene = {} if session.scene is None else {"scene": to_json(session.scene)}
    return scene | ({"events": to_json(list(session.events))} if session.events else {})


def write_parquet(path: Path, session: RecordedSession) -> None:
    """Write the frames as flat columns; scene, annotations, events, date as the file's metadata.

    The metadata's keys are ``mmt.scene`` and ``mmt.events`` (JSON), ``mmt.annotations``
    (bytes) and ``mmt.began_utc_ns`` (decimal digits).

    Raises
    ------
    InputError
        pyarrow is not installed, or see `mmt.session.files.export_session`.
    MmtError
        Writing failed.
    """
    require("pyarrow")
    import pyarrow as pa
    import pyarrow.parquet as pq

    metadata = {f"mmt.{name}".encode(): text.encode() for name, text in _texts(session).items()}
    if session.annotations:
        metadata[b"mmt.annotations"] = session.annotations
    if session.began_utc_ns is not None:
        metadata[b"mmt.began_utc_ns"] = b"%d" % session.began_utc_ns
    columns = {"time_ns": session.frames["time_ns"], **session.columns()}
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    with replacing(path) as part, part.open("wb") as stream:
        pq.write_table(table.replace_schema_metadata(metadata), stream, compression="zstd")


def write_hdf5(path: Path, session: RecordedSession) -> None:
    """Write each field of the frames, scene, annotations, events and models as data sets.

    Data sets: ``sequence``, ``time_ns``, ``time_s`` (n,); the channels as in
    `RecordedSession.vectors`, each with the attribute ``units``; ``annotations`` (uint8);
    ``models/0001`` and on (``.npz`` bytes as uint8, with the attribute ``time_s``); ``scene`` and
    ``events`` (JSON text of fixed length, the only text that Octave's ``load`` accepts). Attributes
    of the file: ``rate_hz``, ``acceleration_rate_hz`` and, if the date is known, ``began_utc``
    (text) and ``began_utc_ns``.

    Raises
    ------
    InputError
        h5py is not installed, or see `mmt.session.files.export_session`.
    MmtError
        Writing failed.
    """
    require("h5py")
    import h5py

    frames = session.frames
    image = io.BytesIO()  # written to a full disk, h5py would crash the whole process
    with h5py.File(image, "w") as file:
        times = {"sequence": frames["sequence"], "time_ns": frames["time_ns"]}
        for name, data in {**times, **session.vectors(), "time_s": session.time_s}.items():
            array = file.create_dataset(name, data=data, compression="gzip", shuffle=True)
            if name in _UNITS:
                array.attrs["units"] = _UNITS[name]
        for name, text in _texts(session).items():
            file[name] = np.bytes_(text)
        if session.annotations:
            file["annotations"] = np.frombuffer(session.annotations, dtype=np.uint8)
        for number, (time_s, model) in enumerate(session.models, start=1):
            data = file.create_dataset(
                f"models/{number:04d}", data=np.frombuffer(model, dtype=np.uint8)
            )
            data.attrs["time_s"] = time_s
        file.attrs["rate_hz"] = FRAMES_HZ
        file.attrs["acceleration_rate_hz"] = FRAMES_HZ * session.samples_per_frame
        if session.began_utc_ns is not None:
            file.attrs["began_utc_ns"] = session.began_utc_ns
            began = datetime.fromtimestamp(session.began_utc_ns / 1e9, UTC)
            file.attrs["began_utc"] = began.isoformat(timespec="milliseconds")
    with replacing(path) as part:
        part.write_bytes(image.getbuffer())


_LARGEST_BYTES: Final = 1 << 32
"""A ``.wav`` stores its length in 32 bits."""
_BYTES: Final = 3 * 4


def write_wav(path: Path, session: RecordedSession) -> None:
    """Write the acceleration, x y z as three channels in single precision.

    1.0 is the full scale: the power of two (m/s2) at or above the largest value, so that scaling
    does not round, and at most 2**127, the largest in single precision. The comment (``ICMT``) is a
    JSON object with ``full_scale_m_s2`` and, if known, ``began_utc_ns``. Sound has no gaps: the
    last sample is repeated for missing frames.

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
    full_scale = 2.0 ** min(127.0, float(np.ceil(np.log2(largest)))) if largest > 0.0 else 1.0
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
                with suppress(InputError):
                    return json_object(stream.read(size - 8)[4:].rstrip(b"\0"), "the comment")
                return {}
            stream.seek(end)
    return {}
