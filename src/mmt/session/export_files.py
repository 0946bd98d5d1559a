"""Export sessions as text, NumPy archives, Parquet (pandas, Polars, DuckDB), HDF5 and MATLAB files.

Data stored beside the frames has the same name in every format that can hold it.
"""

import io
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.extras import require
from mmt.core.files.existing import replacing
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL, FRAMES_HZ
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
    if session.scene is not None:
        arrays["scene_json"] = np.array(to_json(dict(session.scene)))
    if session.annotations:
        arrays["annotations"] = np.frombuffer(session.annotations, dtype=np.uint8)
    if session.events:
        arrays["events_json"] = np.array(to_json([dict(event) for event in session.events]))
    if session.began_utc_ns is not None:
        arrays["began_utc_ns"] = np.int64(session.began_utc_ns)
    return arrays


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

    metadata: dict[bytes, bytes] = {}
    if session.scene is not None:
        metadata[b"mmt.scene"] = to_json(dict(session.scene)).encode()
    if session.annotations:
        metadata[b"mmt.annotations"] = session.annotations
    if session.events:
        metadata[b"mmt.events"] = to_json([dict(event) for event in session.events]).encode()
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
        if session.scene is not None:
            file["scene"] = np.bytes_(to_json(dict(session.scene)))
        if session.events:
            file["events"] = np.bytes_(to_json([dict(event) for event in session.events]))
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
