"""Open a session file to read it in parts, from beginning to end or in windows."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Union

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.session.data import RecordedSession
from mmt.session.files import read_session
from mmt.session.windows import MemoryWindows

if TYPE_CHECKING:
    from mmt.session.mcap.index import IndexedSession

Recording = Union[RecordedSession, "IndexedSession"]
"""A recorded session, in memory or in its file."""
SessionWindows = Union[MemoryWindows, "IndexedSession"]
"""A recording that is read in windows, in memory or in its file."""


def common_samples_per_frame(sessions: Sequence[Recording]) -> int:
    """Return the samples of acceleration per frame that sessions, at least one, have in common.

    Raises
    ------
    InputError
        The numbers differ.
    """
    first = sessions[0]
    for other in sessions[1:]:
        if other.samples_per_frame != first.samples_per_frame:
            raise InputError(
                f"the acceleration of {first.path} is at {first.samples_per_frame} kHz, that of "
                f"{other.path} at {other.samples_per_frame} kHz: import them at one rate "
                "(--acceleration-rate)"
            )
    return first.samples_per_frame


def open_recording(path: Path) -> Recording:
    """Open a session file of any readable format for sequential reading.

    The frames of an ``.mcap`` file stay on disk if they are in order. Other files are read whole.

    Raises
    ------
    InputError
        See `mmt.read_session`.
    """
    indexed = None
    if path.suffix.lower() == ".mcap":
        from mmt.session.mcap.index import IndexedSession

        indexed = IndexedSession.open_in_order(path)
    return read_session(path) if indexed is None else indexed


def blocks_of(recording: Recording) -> Iterator[RecordArray]:
    """Return an iterator over a recording's frames, in blocks (n,)."""
    return (
        iter([recording.frames]) if isinstance(recording, RecordedSession) else recording.blocks()
    )


def in_memory(recording: Recording) -> RecordedSession:
    """Return a recording with all its frames in memory.

    Raises
    ------
    InputError
        See `mmt.read_session`.
    """
    return recording if isinstance(recording, RecordedSession) else read_session(recording.path)


def open_windows(path: str | Path) -> SessionWindows:
    """Open a session file of any readable format.

    An ``.mcap`` file is read by its index, a few chunks for each window. A cut-off file and
    files of other formats have no index and are read into memory.

    Raises
    ------
    InputError
        The file is missing, of an unknown format, not valid, or holds no frames.
    """
    path = Path(path)
    if path.suffix.lower() != ".mcap":
        return MemoryWindows(read_session(path))
    from mmt.session.mcap.index import IndexedSession
    from mmt.session.mcap.reader import scanned_session
    from mmt.session.mcap.scan import scan_mcap

    indexed = IndexedSession.open(path)
    if indexed is None:
        return MemoryWindows(scanned_session(scan_mcap(path)))
    if not indexed.has_frames:
        raise InputError(f"session {path}: it holds no frames")
    return indexed
