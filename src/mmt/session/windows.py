"""Read windows of a recorded session without reading the whole file.

*Recording time* is in seconds from the first frame. If recording began in mid-session, it is
less than the session time in the events' ``time_s``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import Channel
from mmt.session.data import JsonObject, OutputBlock, RecordedSession, duration_s, event_time_s


@dataclass(frozen=True, eq=False)
class Window:
    """The content of a recording between two times.

    ``frames`` (n,) are in order of sequence, ``time_s`` (n,) is the recording time of each.
    ``outputs`` are the leader's blocks that overlap the window, in recording time.
    ``arrivals`` (m, 2) are the leader's clock (ns) at the arrival of each block of frames, and
    the follower's clock at its measurement; m = 0 if these were not recorded.
    """

    time_s: FloatArray
    frames: RecordArray
    outputs: Sequence[OutputBlock] = ()
    arrivals: IntArray = field(default_factory=lambda: np.zeros((0, 2), np.int64))


def overlapping(outputs: Sequence[OutputBlock], begin_s: float, end_s: float) -> list[OutputBlock]:
    """Return the blocks that have a sample from `begin_s` up to before `end_s`."""
    return [output for output in outputs if output.time_s < end_s and output.end_s > begin_s]


class MemoryWindows:
    """Windows of a session in memory; any thread may read.

    ``samples_per_frame`` is that of acceleration and of the output, ``has_output`` tells whether
    the leader's output was recorded. ``events`` are in order, each with its recording time as
    ``at_s``. The other attributes are those of `RecordedSession`.

    Raises
    ------
    InputError
        The session has no frames.
    """

    in_memory = True

    def __init__(self, session: RecordedSession) -> None:
        if len(session.frames) == 0:
            raise InputError(f"session {session.path}: it holds no frames")
        self.path = session.path
        self.scene: JsonObject | None = session.scene
        self.session_id: str | None = session.session_id
        self.channels: tuple[Channel, ...] = session.channels
        outputs = [output.samples_per_frame for output in session.outputs[:1]]
        self.samples_per_frame = max(session.samples_per_frame, *outputs, 1)
        self.has_output = bool(session.outputs)
        self._frames = session.frames
        self._time_s = np.maximum.accumulate(session.time_s)
        self._outputs = list(session.outputs)
        ends_s = [output.end_s for output in self._outputs[-1:]]
        self.duration_s = max([duration_s(session.frames), float(self._time_s[-1]), *ends_s])
        self.events: Sequence[JsonObject] = [
            {**event, "at_s": event_time_s(event)} for event in session.events
        ]

    def window(self, begin_s: float, end_s: float) -> Window:
        """Return the content from `begin_s` up to before `end_s`, in recording time."""
        first, stop = np.searchsorted(self._time_s, [begin_s, end_s]).tolist()
        outputs = overlapping(self._outputs, begin_s, end_s)
        return Window(self._time_s[first:stop], self._frames[first:stop], outputs)
