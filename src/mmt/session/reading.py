"""Read sessions and import other people's recordings; the suffix chooses how.

A new kind of file is one new module and one line in a table here.
"""

from pathlib import Path
from typing import Final

from mmt.core.errors import InputError
from mmt.session.recorded import RecordedSession
from mmt.session.suffixes import choose

IMPORTERS: Final = {
    ".npz": "mmt.session.npz_file:read_npz",
    ".csv": "mmt.session.csv_file:read_csv",
}
"""Other people's recordings: a function of (path, longest_gap_s)."""

READERS: Final = {".mcap": "mmt.session.mcap_reader:read_mcap", **IMPORTERS}
"""Every kind that is read: a function of (path)."""


def read_session(path: Path) -> RecordedSession:
    """Read a session from a file of any readable kind.

    A ``.npz`` or ``.csv`` that is not at 1 kHz is resampled, see `import_session`.

    Raises
    ------
    InputError
        The file is missing, of another kind, not valid, or was cut off.
    """
    session: RecordedSession = choose(path, READERS, "read")(path)
    return session


def import_session(path: Path, *, longest_gap_s: float | None = None) -> RecordedSession:
    """Read somebody else's recording and resample it to 1 kHz.

    Parameters
    ----------
    path
        A ``.npz`` with the arrays ``time_s`` (n,), ``position_mm``, ``force_n`` and
        ``acceleration_m_s2`` (n, 3), and optionally ``acceleration_time_s`` where the
        acceleration has its own rate; or a ``.csv`` with the same as columns
        (``time_s``, ``position_x_mm``, ...). Channels may be left out.
    longest_gap_s
        Samples further apart than this are not joined: the frames between them are
        missing in the session. None takes five of the file's own median intervals, but
        no less than 5 ms and no more than 100 ms.

    Raises
    ------
    InputError
        The file is missing or not valid; the message names the array or column and the
        row.
    """
    if longest_gap_s is not None and not longest_gap_s > 0:
        raise InputError(f"longest_gap_s is {longest_gap_s}, it must be above zero")
    session: RecordedSession = choose(path, IMPORTERS, "imported")(path, longest_gap_s)
    return session
