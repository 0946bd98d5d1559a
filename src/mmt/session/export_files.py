"""Export sessions as Parquet (pandas, Polars, DuckDB) and HDF5 (MATLAB, Julia, h5py)."""

from pathlib import Path

import numpy as np

from mmt.core.extras import require
from mmt.session.data import RecordedSession, to_json
from mmt.session.files import replacing


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

    Data sets: ``sequence``, ``time_ns``, ``time_s`` (n,), the channels (n, 3);
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
    with replacing(path) as part, h5py.File(part, "w") as file:
        for name in frames.dtype.names or ():
            file.create_dataset(name, data=frames[name], compression="gzip", shuffle=True)
        file.create_dataset("time_s", data=session.time_s, compression="gzip", shuffle=True)
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
