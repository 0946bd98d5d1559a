"""Import a recording: read its columns, map them, make frames, and say what was found."""

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Final

from mmt.core.errors import InputError
from mmt.session.data import RecordedSession
from mmt.session.importing.checks import ImportReport, assess
from mmt.session.importing.columns import Columns, to_samples, wanted_names
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.resampling import to_frames

_TEXT = "mmt.session.importing.text_file:read_text"
_BAG = "mmt.session.importing.ros_bag:read_bag"

READERS: Final = {
    ".npz": "mmt.session.importing.array_file:read_archive",
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat"), _TEXT),
    ".xlsx": "mmt.session.importing.spreadsheet:read_spreadsheet",
    ".mat": "mmt.session.importing.matlab_file:read_matlab",
    **dict.fromkeys((".db3", ".mcap", ".bag"), _BAG),
}
"""What is imported: a function of (path, whether a column of a name is wanted). A folder is a
ROS 2 bag."""


def import_recording(
    path: str | Path, options: ImportOptions | None = None
) -> tuple[RecordedSession, ImportReport]:
    """Read a recording of another program, resampled to 1 kHz, and say what was found in it.

    Raises
    ------
    InputError
        See `mmt.session.import_session`.
    """
    path, options = Path(path), options or ImportOptions()
    columns = read_columns(path, wanted_names(options))
    samples = to_samples(columns, options)
    if options.blanks_as_gaps:
        samples = samples.without_blanks()
    frames, stamps, resampled = to_frames(samples, options.longest_gap_s, options.stamps)
    session = RecordedSession(
        frames=frames,
        scene=columns.scene,
        annotations=columns.annotations,
        events=columns.events,
        path=path,
    )
    return session, assess(frames, samples, stamps, options, resampled=resampled)


def read_columns(path: Path, wanted: Callable[[str], bool]) -> Columns:
    """Read the columns of a file whose names are `wanted`.

    Raises
    ------
    InputError
        The file is missing, of another kind or not valid, or a package that reads it is not
        installed.
    """
    name = _BAG if path.is_dir() else READERS.get(path.suffix.lower())
    if name is None:
        given = path.suffix or "a name without suffix"
        raise InputError(
            f"session {path}: {given} cannot be read; the suffix must be one of "
            f"{', '.join(READERS)}, or the name that of a folder with a ROS 2 bag"
        )
    module, _, function = name.partition(":")
    read: Callable[[Path, Callable[[str], bool]], Columns]
    read = getattr(importlib.import_module(module), function)
    return read(path, wanted)
