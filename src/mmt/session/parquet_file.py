"""Export sessions as Parquet, for pandas, Polars and DuckDB."""

from pathlib import Path

from mmt.core.errors import InputError
from mmt.session.flat import flat_columns
from mmt.session.jsontext import to_json
from mmt.session.recorded import RecordedSession
from mmt.session.replacing import replacing


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
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise InputError(
            f"export {path}: Parquet needs pyarrow: pip install 'mmt-haptics[export]'"
        ) from error
    metadata: dict[bytes, bytes] = {}
    if session.scene is not None:
        metadata[b"mmt.scene"] = to_json(dict(session.scene)).encode()
    if session.annotations:
        metadata[b"mmt.annotations"] = session.annotations
    if session.events:
        metadata[b"mmt.events"] = to_json([dict(event) for event in session.events]).encode()
    columns = {"time_ns": session.frames["time_ns"], **flat_columns(session)}
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    with replacing(path) as part, part.open("wb") as stream:
        pq.write_table(table.replace_schema_metadata(metadata), stream, compression="zstd")
