"""Export sessions as text, NumPy archives, Parquet (pandas, Polars, DuckDB) and HDF5 (MATLAB)."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from mmt.core.existing_files import replacing
from mmt.core.extras import require
from mmt.session.data import RecordedSession, to_json


def write_csv(path: Path, session: RecordedSession) -> None:
    """Write the frames; single precision needs nine digits.

    Raises
    ------
    InputError, MmtError
        See `mmt.session.export_session`.
    """
    columns = session.columns()
    formats = [
        "%d" if values.dtype.kind in "iu" else "%.9f" if name == "time_s" else "%.9g"
        for name, values in columns.items()
    ]
    table = np.column_stack([values.astype(np.float64) for values in columns.values()])
    with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as stream:
        np.savetxt(stream, table, fmt=formats, delimiter=",", header=",".join(columns), comments="")


def write_npz(path: Path, session: RecordedSession) -> None:
    """Write frames, scene, annotations and events.

    Raises
    ------
    InputError, MmtError
        See `mmt.session.export_session`.
    """
    arrays: dict[str, Any] = {"sequence": session.frames["sequence"], "time_s": session.time_s}
    arrays |= session.vectors()
    if session.scene is not None:
        arrays["scene_json"] = np.array(to_json(dict(session.scene)))
    if session.annotations:
        arrays["annotations"] = np.frombuffer(session.annotations, dtype=np.uint8)
    if session.events:
        arrays["events_json"] = np.array(to_json([dict(event) for event in session.events]))
    with replacing(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


def write_parquet(path: Path, session: RecordedSession) -> None:
    """Write the frames as flat columns; scene, annotations, events as the file's metadata.

    The metadata's keys are ``mmt.scene`` and ``mmt.events`` (JSON), ``mmt.annotations``
    (bytes).

    Raises
    ------
    InputError
        pyarrow is not installed, or see `mmt.session.export_session`.
    MmtError
        Writing failed.
    """
    require("pyarrow")
    import pyarrow as pa
    import pyarrow.parquet as pq

    metadata: dict[bytes, bytes] = {}
    if session.scene is not None:
        metadata[b"mmt.scene"] = to_json(dict(session.scene)).encode()
    if session.annotations:
        metadata[b"mmt.annotations"] = session.annotations
    if session.events:
        metadata[b"mmt.events"] = to_json([dict(event) for event in session.events]).encode()
    columns = {"time_ns": session.frames["time_ns"], **session.columns()}
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    with replacing(path) as part, part.open("wb") as stream:
        pq.write_table(table.replace_schema_metadata(metadata), stream, compression="zstd")


def write_hdf5(path: Path, session: RecordedSession) -> None:
    """Write each field of the frames as a data set, and everything that belongs to them.

    Data sets: ``sequence``, ``time_ns``, ``time_s`` (n,), the channels as of
    `RecordedSession.vectors`;
    ``annotations`` (bytes as uint8); ``models/0001`` and on (``.npz`` bytes as uint8, with the
    attribute ``time_s``); ``scene`` and ``events`` (JSON text).

    Raises
    ------
    InputError
        h5py is not installed, or see `mmt.session.export_session`.
    MmtError
        Writing failed.
    """
    require("h5py")
    import h5py

    frames = session.frames
    image = io.BytesIO()  # on a full disk, the library brings the whole process down
    with h5py.File(image, "w") as file:
        times = {"sequence": frames["sequence"], "time_ns": frames["time_ns"]}
        for name, data in {**times, **session.vectors(), "time_s": session.time_s}.items():
            file.create_dataset(name, data=data, compression="gzip", shuffle=True)
        if session.scene is not None:
            file["scene"] = to_json(dict(session.scene))
        if session.events:
            file["events"] = to_json([dict(event) for event in session.events])
        if session.annotations:
            file["annotations"] = np.frombuffer(session.annotations, dtype=np.uint8)
        for number, (time_s, model) in enumerate(session.models, start=1):
            data = file.create_dataset(
                f"models/{number:04d}", data=np.frombuffer(model, dtype=np.uint8)
            )
            data.attrs["time_s"] = time_s
    with replacing(path) as part:
        part.write_bytes(image.getbuffer())
