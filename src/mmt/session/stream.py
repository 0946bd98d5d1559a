"""Read a session file from beginning to end, a few chunks at a time, to bound memory."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Union

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.session.data import RecordedSession
from mmt.session.files import read_session

if TYPE_CHECKING:
    from mmt.session.mcap.index import IndexedSession

Recording = Union[RecordedSession, "IndexedSession"]
"""A recorded session, in memory or in its file."""


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
