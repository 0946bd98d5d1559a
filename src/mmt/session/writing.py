"""Write and export sessions; the suffix chooses how.

A new kind of file is one new module and one line in the table here.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from mmt.core.arrays import RecordArray
from mmt.session.recorded import JsonObject, OutputBlock, RecordedSession
from mmt.session.suffixes import choose

WRITERS: Final = {
    ".mcap": "mmt.session.mcap_writer:write_mcap",
    ".npz": "mmt.session.npz_file:write_npz",
    ".csv": "mmt.session.csv_file:write_csv",
    ".parquet": "mmt.session.parquet_file:write_parquet",
    ".h5": "mmt.session.hdf5_file:write_hdf5",
    ".hdf5": "mmt.session.hdf5_file:write_hdf5",
}
"""Every kind that is written: a function of (path, session)."""


def export_session(session: RecordedSession, path: Path) -> None:
    """Write a session to a file of the kind that the suffix names.

    MCAP holds everything; ``.npz``, ``.parquet``, ``.h5`` hold frames, scene, annotations
    and events (HDF5 the models too), ``.csv`` the frames alone.

    Raises
    ------
    InputError
        The suffix is not known, the folder does not exist, or the package that writes
        the kind is not installed.
    MmtError
        Writing failed.
    """
    choose(path, WRITERS, "written")(path, session)


def write_session(
    path: Path,
    frames: RecordArray,
    *,
    scene: JsonObject | None = None,
    annotations: bytes = b"",
    models: Sequence[tuple[float, bytes]] = (),
    events: Sequence[JsonObject] = (),
    outputs: Sequence[OutputBlock] = (),
) -> None:
    """Write frames (n,) and what belongs to them as a session; see `RecordedSession`.

    Raises
    ------
    InputError, MmtError
        As `export_session`.
    """
    session = RecordedSession(frames, scene, annotations, models, events, outputs, path)
    export_session(session, path)
