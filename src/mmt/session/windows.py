"""Look into a recorded session at any moment, without reading the rest of it.

*Recording time* counts seconds from the first frame; in a recording that began in mid-session
it is less than the session time that its events carry.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, RecordArray
from mmt.core.frames import Channel
from mmt.session.recorded import JsonObject, OutputBlock


def _no_arrivals() -> IntArray:
    return np.zeros((0, 2), np.int64)


@dataclass(frozen=True, eq=False)
class Window:
    """What a recording holds between two moments.

    ``frames`` (n,) are in the order of their numbers, ``time_s`` (n,) is the recording time
    of each. ``outputs`` are the leader's blocks that overlap the window, with their recording
    time. ``arrivals`` (m, 2) are the leader's and the follower's clock (ns) when a block of
    frames came and was measured; without rows where that was not recorded.
    """

    time_s: FloatArray
    frames: RecordArray
    outputs: Sequence[OutputBlock] = ()
    arrivals: IntArray = field(default_factory=_no_arrivals)


class SessionWindows(Protocol):
    """A recording that is looked into window by window; not for two threads at a time."""

    path: Path
    scene: JsonObject | None
    session_id: str | None
    channels: tuple[Channel, ...]
    duration_s: float
    events: Sequence[JsonObject]
    """In order, each with its recording time as ``at_s``."""
    has_output: bool
    """Whether it holds what the leader wrote to its actuator."""
    in_memory: bool
    """Whether the whole session is held in memory."""

    def window(self, begin_s: float, end_s: float) -> Window:
        """Return what lies from `begin_s` up to before `end_s`, in recording time."""

    def again(self) -> Self:
        """Return another view of the same recording, for another thread."""

    def close(self) -> None:
        """Close the file."""


def overlapping(outputs: Sequence[OutputBlock], begin_s: float, end_s: float) -> list[OutputBlock]:
    """Return the blocks that have a sample from `begin_s` up to before `end_s`."""
    return [
        output
        for output in outputs
        if output.time_s < end_s and output.time_s + len(output.vibration_m_s2) / 1e3 > begin_s
    ]
