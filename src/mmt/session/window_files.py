"""Open a session file to look into it, by its index or read whole."""

from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np

from mmt.core.errors import InputError
from mmt.core.frames import Channel
from mmt.session.recorded import JsonObject, RecordedSession, duration_s
from mmt.session.windows import SessionWindows, Window, overlapping


def open_windows(path: Path) -> SessionWindows:
    """Open a session file of any readable kind.

    A whole ``.mcap`` file is read by its index, a few chunks for a window. One that was cut
    off has no index, other kinds neither: they are read whole.

    Raises
    ------
    InputError
        The file is missing, of another kind, not valid, or holds no frames.
    """
    from mmt.session.reading import read_session

    if path.suffix.lower() != ".mcap":
        return MemoryWindows(read_session(path))
    from mmt.session.mcap_reader import scan_mcap, session_of
    from mmt.session.mcap_windows import McapWindows

    indexed = McapWindows.open(path)
    return indexed if indexed is not None else MemoryWindows(session_of(scan_mcap(path)))


class MemoryWindows:
    """A session that is held in memory.

    Raises
    ------
    InputError
        It holds no frames.
    """

    in_memory = True

    def __init__(self, session: RecordedSession) -> None:
        if len(session.frames) == 0:
            raise InputError(f"session {session.path}: it holds no frames, there is nothing to see")
        self.path = session.path
        self.scene: JsonObject | None = session.scene
        self.session_id: str | None = session.session_id
        self.channels: tuple[Channel, ...] = session.channels
        self.has_output = bool(session.outputs)
        self._frames = session.frames
        self._time_s = np.maximum.accumulate(session.time_s)
        self._outputs = list(session.outputs)
        ends_s = [o.time_s + len(o.vibration_m_s2) / 1e3 for o in self._outputs[-1:]]
        self.duration_s = max([duration_s(session.frames), float(self._time_s[-1]), *ends_s])
        self.events: Sequence[JsonObject] = [
            {**event, "at_s": float(event.get("time_s", 0.0))} for event in session.events
        ]

    def window(self, begin_s: float, end_s: float) -> Window:
        """See `SessionWindows.window`."""
        first, stop = np.searchsorted(self._time_s, [begin_s, end_s]).tolist()
        outputs = overlapping(self._outputs, begin_s, end_s)
        return Window(self._time_s[first:stop], self._frames[first:stop], outputs)

    def again(self) -> Self:
        """Return itself: it does not change."""
        return self

    def close(self) -> None:
        """Nothing is open."""
