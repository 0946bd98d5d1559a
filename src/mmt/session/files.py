"""Read, import, write and export session files; the suffix chooses the format.

A new format is one new module and one line in a table here. Its module is imported when a
file of that format is read or written.
"""

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError, MmtError
from mmt.session.data import JsonObject, OutputBlock, RecordedSession

IMPORTERS: Final = {
    ".npz": "mmt.session.npz_file:read_npz",
    ".csv": "mmt.session.csv_file:read_csv",
}
"""Recordings of other programs: a function of (path, longest_gap_s)."""

READERS: Final = {".mcap": "mmt.session.mcap_reader:read_mcap", **IMPORTERS}
"""Every format that is read: a function of (path)."""

WRITERS: Final = {
    ".mcap": "mmt.session.mcap_writer:write_mcap",
    ".npz": "mmt.session.npz_file:write_npz",
    ".csv": "mmt.session.csv_file:write_csv",
    ".parquet": "mmt.session.export_files:write_parquet",
    ".h5": "mmt.session.export_files:write_hdf5",
    ".hdf5": "mmt.session.export_files:write_hdf5",
}
"""Every format that is written: a function of (path, session)."""


def read_session(path: str | Path) -> RecordedSession:
    """Read a session from a file of any readable format.

    A ``.npz`` or ``.csv`` that is not at 1 kHz is resampled, see `import_session`.

    Raises
    ------
    InputError
        The file is missing, of another format, not valid, or was cut off.

    Examples
    --------
    >>> import mmt
    >>> frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=2.0)
    >>> mmt.write_session("wood.mcap", frames)
    >>> mmt.read_session("wood.mcap")
    <RecordedSession wood.mcap: 2.0 s, 2000 frames of position, force, acceleration>
    """
    path = Path(path)
    session: RecordedSession = _choose(path, READERS, "read")(path)
    return session


def import_session(path: str | Path, *, longest_gap_s: float | None = None) -> RecordedSession:
    """Read a recording of another program and resample it to 1 kHz.

    Parameters
    ----------
    path
        A ``.npz`` with the arrays ``time_s`` (n,), ``position_mm``, ``force_n`` and
        ``acceleration_m_s2`` (n, 3), and optionally ``acceleration_time_s`` where the
        acceleration has its own rate; or a ``.csv`` with the same as columns
        (``time_s``, ``position_x_mm``, ...). Channels may be left out.
    longest_gap_s
        Samples further apart than this are not joined: the frames between them are
        missing in the session. None is five of the file's own median intervals, but
        no less than 5 ms and no more than 100 ms.

    Raises
    ------
    InputError
        The file is missing or not valid; the message names the array or column and the
        row.
    """
    path = Path(path)
    if longest_gap_s is not None and not longest_gap_s > 0:
        raise InputError(f"longest_gap_s is {longest_gap_s}, it must be above zero")
    session: RecordedSession = _choose(path, IMPORTERS, "imported")(path, longest_gap_s)
    return session


def export_session(session: RecordedSession, path: str | Path) -> None:
    """Write a session to a file of the format that the suffix names.

    MCAP holds everything; ``.npz``, ``.parquet``, ``.h5`` hold frames, scene, annotations
    and events (HDF5 the models too), ``.csv`` the frames alone.

    Raises
    ------
    InputError
        The suffix is not known, the folder does not exist, or the package that writes
        the format is not installed.
    MmtError
        Writing failed.
    """
    path = Path(path)
    _choose(path, WRITERS, "written")(path, session)


def write_session(
    path: str | Path,
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
    path = Path(path)
    session = RecordedSession(frames, scene, annotations, models, events, outputs, path)
    export_session(session, path)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a file next to `path` to write to; it replaces `path` when the block succeeds.

    Raises
    ------
    InputError
        The folder does not exist or may not be written to.
    MmtError
        Writing failed, for instance because the disk is full; nothing is left behind.
    """
    part = path.with_name(path.name + ".part")
    try:
        part.touch()
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from error
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise MmtError(f"writing {path} failed: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _choose(path: Path, table: Mapping[str, str], verb: str) -> Callable[..., Any]:
    """Return the function that a table of ``suffix: "module:function"`` has for a file.

    Raises
    ------
    InputError
        The suffix is not in the table; the message says what cannot be done (`verb`, as
        in "read") and which suffixes are known.
    """
    name = table.get(path.suffix.lower())
    if name is None:
        given = path.suffix or "a name without suffix"
        raise InputError(
            f"session {path}: {given} cannot be {verb}; the suffix must be one of "
            f"{', '.join(table)}"
        )
    module, _, function = name.partition(":")
    chosen: Callable[..., Any] = getattr(importlib.import_module(module), function)
    return chosen
