"""Read, import, write and export session files; the suffix selects the format.

The formats are entry points, see `mmt.session.formats`; the module of a format is imported on
first use.
"""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.session.data import JsonObject, OutputBlock, RecordedSession, check_recording
from mmt.session.formats import find_format, suffixes

_log = logging.getLogger(__name__)


def read_session(path: str | Path) -> RecordedSession:
    """Read a session from a file of any readable format.

    Files of formats other than ``.mcap`` are read by `import_session`, which logs warnings.

    Raises
    ------
    InputError
        The file is missing, of an unknown format, not valid, or was cut off.

    Examples
    --------
    >>> import mmt
    >>> frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=2.0)
    >>> mmt.write_session("wood.mcap", frames)
    >>> mmt.read_session("wood.mcap")
    <RecordedSession wood.mcap: 2.0 s, 2000 frames of position, force, acceleration>
    """
    path = Path(path)
    read = find_format("read", path)
    if read is not None:
        session: RecordedSession = read(path)
        return session
    try:
        return import_session(path)
    except InputError as error:
        if "--" not in str(error):
            raise
        import_first = "to give such options, import it first: mmt session import"
        raise InputError(f"{error}; {import_first}") from error


def import_session(
    path: str | Path | Sequence[str | Path],
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    **options: Any,
) -> RecordedSession:
    """Read another program's recording and resample it to 1 kHz.

    Suspicious data, such as an unlikely unit, a wrong sign of the force or jittered time stamps,
    is logged as a warning. The option ``acceleration_rate_hz`` sets the acceleration's rate.

    Parameters
    ----------
    path
        A ``.npz`` or ``.mat`` with the arrays ``time_s`` (n,), ``position_mm``, ``force_n`` and
        ``acceleration_m_s2`` (n, 3), a table (``.csv``, ``.txt``, ``.xlsx``, ``.parquet``) with
        these as columns (``time_s``, ``position_x_mm``, ...), a ROS bag, or a LeRobot data
        set. Channels may be missing, and each may have its own times
        (``acceleration_time_s``). Or several files of one recording, such as
        ``["pose.csv", "acc.wav"]``.
    columns
        The file's names of columns, if they differ, such as ``{"force_z": "Fz"}``; with several
        files ``{"acceleration": "acc.wav:1*50"}``.
    units
        Units that override those in the file, such as ``{"acceleration": "g"}``.
    **options
        Other options of the command ``mmt session import``, by the names of
        `mmt.session.importing.options.ImportOptions`: ``rate_hz``, ``acceleration_rate_hz``,
        ``blanks_as_gaps``, ``longest_gap_s``, ``stamps``, ``episode``, ``header``, ``sheet``,
        ``separator``, ``decimal``, ``missing``, ``tool_axes``, ``offsets``,
        ``reading_memory_gb``, ``reading_time_s``.

    Raises
    ------
    InputError
        The file is missing or not valid, reading it takes too much memory or time, or a column or
        its unit is not known; the message names the array or the column and row.
    """
    from mmt.session.importing.options import ImportOptions
    from mmt.session.importing.recording import import_recording

    session, report = import_recording(path, ImportOptions(columns or {}, units or {}, **options))
    for warning in report.warnings:
        _log.warning("look: %s: %s", path, warning)
    return session


def export_session(session: RecordedSession, path: str | Path, *, scalars: bool = False) -> None:
    """Write a session to a file; the suffix selects the format.

    MCAP holds everything; with `scalars` also a message for each frame and each sample of the
    output, for tools that plot numbers. ``.npz``, ``.mat``, ``.parquet`` and ``.h5`` hold frames,
    scene, annotations and events (HDF5 also the models), ``.csv`` only the frames, ``.wav`` only
    the acceleration. A path without suffix becomes a folder with a ROS 2 bag: frames, scene and
    events. All formats hold the date.

    Raises
    ------
    InputError
        The suffix is not known, the folder does not exist, the package that writes the
        format is not installed, or `scalars` is given with a format other than MCAP.
    MmtError
        Writing failed.
    """
    check_recording(session)
    path = Path(path)
    write = find_format("write", path)
    if write is None:
        raise InputError(
            f"session {path}: {path.suffix} cannot be written; the suffix must be one of "
            f"{', '.join(suffixes('write'))}, or none for a ROS 2 bag"
        )
    if scalars and path.suffix.lower() != ".mcap":
        raise InputError(
            f"session {path}: scalars are messages of .mcap files; leave --scalars out"
        )
    write(path, session, **({"scalars": True} if scalars else {}))


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
    """Write frames (n,) and other data as a session; see `RecordedSession` and `export_session`.

    Raises
    ------
    InputError, MmtError
        As `export_session`.
    """
    path = Path(path)
    session = RecordedSession(frames, scene, annotations, models, events, outputs, path)
    export_session(session, path)
