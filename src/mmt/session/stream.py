"""Read a session file from beginning to end, a few chunks at a time, to bound memory."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import samples_per_frame
from mmt.session.data import JsonObject, RecordedSession
from mmt.session.files import read_session

if TYPE_CHECKING:
    from mmt.session.messages import FrameCodec

_MCAP: Final = ".mcap"


@dataclass(frozen=True, eq=False)
class SessionStream:
    """A session whose frames stay in its file; for other fields see `RecordedSession`."""

    path: Path
    codec: "FrameCodec" = field(repr=False)
    """Codec of the messages with frames."""
    scene: JsonObject | None = None
    annotations: bytes = b""
    complete: bool = True
    events: Sequence[JsonObject] = ()
    """The events if the scene has ``[control]``, else empty."""

    @property
    def samples_per_frame(self) -> int:
        """Samples of acceleration per frame."""
        return samples_per_frame(self.codec.dtype)

    def blocks(self) -> Iterator[RecordArray]:
        """Yield the frames (n,) of a few chunks at a time; each call starts at the beginning.

        Raises
        ------
        InputError
            The file is damaged; the message says how to recover it.
        """
        from mmt.session.mcap_chunks import frame_payloads

        for payloads in frame_payloads(self.path):
            yield self.codec.decode(payloads)


Recording = RecordedSession | SessionStream
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
    if path.suffix.lower() == _MCAP:
        from mmt.session.mcap_chunks import open_in_order

        stream = open_in_order(path)
        if stream is not None:
            return SessionStream(path, *stream)
    return read_session(path)


def blocks_of(recording: Recording) -> Iterator[RecordArray]:
    """Return an iterator over a recording's frames, in blocks (n,)."""
    return recording.blocks() if isinstance(recording, SessionStream) else iter([recording.frames])


def in_memory(recording: Recording) -> RecordedSession:
    """Return a recording with all its frames in memory.

    Raises
    ------
    InputError
        See `mmt.read_session`.
    """
    return read_session(recording.path) if isinstance(recording, SessionStream) else recording
