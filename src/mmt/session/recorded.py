"""A recorded session as every reader returns it and every writer takes it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.frames import Channel, channels_of

FRAME_PERIOD_NS = 1_000_000
"""Frames come at 1 kHz."""

JsonObject = Mapping[str, Any]
"""What a JSON object holds is known to the one who wrote it."""


@dataclass(frozen=True, eq=False)
class OutputBlock:
    """Consecutive samples that the leader wrote to its actuator."""

    time_s: float
    """Session time of the first sample."""
    mode: str
    """Where the vibration came from, as the leader names it."""
    vibration_m_s2: FloatArray
    """Shape (n,), 1 kHz, stored in single precision."""


@dataclass(frozen=True, eq=False)
class RecordedSession:
    """One session, whole in memory.

    Session time, ``time_s`` below, is zero at the first frame.
    """

    frames: RecordArray
    """Shape (n,), the dtype of `mmt.core.frames.frame_dtype`; missing frames are jumps in
    ``sequence``."""
    scene: JsonObject | None = None
    """The resolved scene, None where the file holds none."""
    annotations: bytes = b""
    """What the follower attached to the session, such as the simulated truth."""
    models: Sequence[tuple[float, bytes]] = ()
    """Texture models (bytes of a ``.npz``) with the session time of each, in order."""
    events: Sequence[JsonObject] = ()
    """What happened, in order, each with its ``time_s``."""
    outputs: Sequence[OutputBlock] = ()
    """The leader's rendered vibration."""
    path: Path = field(default=Path())
    """The file it was read from."""
    session_id: str | None = None
    """Names the session in the logs and summaries of both services; None where none is known."""
    complete: bool = True
    """False where the file was cut off and then mended."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels that the frames carry."""
        return channels_of(self.frames.dtype)

    @property
    def time_s(self) -> FloatArray:
        """Session time of the frames, shape (n,); zero at the first."""
        time_ns = self.frames["time_ns"]
        return np.asarray((time_ns - time_ns[:1]) / 1e9, dtype=np.float64)


def missing_frames(frames: RecordArray) -> int:
    """Return how many frames are missing inside a session: the jumps in ``sequence``.

    A sequence that falls (a follower that started anew) is no gap.
    """
    jumps = np.diff(frames["sequence"].astype(np.int64))
    return int(np.sum(jumps[jumps > 1] - 1))


def duration_s(frames: RecordArray) -> float:
    """Return the time from the first frame to the end of the last one's period."""
    if len(frames) == 0:
        return 0.0
    span_ns = int(frames["time_ns"][-1]) - int(frames["time_ns"][0])
    return (span_ns + FRAME_PERIOD_NS) / 1e9
