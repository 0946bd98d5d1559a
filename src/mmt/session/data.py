"""A recorded session in memory, as every reader returns it and every writer expects it."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, RecordArray
from mmt.core.drawn import Drawn
from mmt.core.frames import (
    FIELD_OF_CHANNEL,
    FRAMES_HZ,
    Channel,
    acceleration_samples,
    channels_of,
    samples_per_frame,
)

FRAME_PERIOD_NS = 1_000_000
"""Frames come at 1 kHz."""
FRAME_PERIOD_S = 1e-3

_Times = TypeVar("_Times", IntArray, FloatArray)

JsonObject = Mapping[str, Any]
"""A JSON object; only the program that wrote it knows its keys."""


@dataclass(frozen=True, eq=False)
class OutputBlock:
    """Consecutive samples that the leader wrote to its actuator."""

    time_s: float
    """Session time of the first sample."""
    mode: str
    """Where the vibration came from, as the leader names it."""
    vibration_m_s2: FloatArray
    """Shape (n,), stored in single precision."""
    samples_per_frame: int = 1
    """Samples in a frame's time, as of the session's acceleration."""

    @property
    def rate_hz(self) -> float:
        """Samples a second."""
        return FRAMES_HZ * self.samples_per_frame

    @property
    def end_s(self) -> float:
        """Session time of the end of the last sample's period."""
        return self.time_s + len(self.vibration_m_s2) / self.rate_hz


@dataclass(frozen=True, eq=False, repr=False)
class RecordedSession(Drawn):
    """One session, whole in memory.

    Session time, ``time_s`` below, is zero at the first frame.

    Examples
    --------
    >>> import mmt
    >>> frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=2.0)
    >>> mmt.RecordedSession(frames)
    <RecordedSession: 2.0 s, 2000 frames of position, force, acceleration>
    """

    frames: RecordArray
    """Shape (n,), the dtype of `mmt.core.frames.frame_dtype`: ``sequence``, ``time_ns`` and,
    of the channels that were recorded, ``position_mm``, ``force_n`` and
    ``acceleration_m_s2``, (3,) each, or (k, 3) where a frame has k samples of acceleration.
    Missing frames are jumps in ``sequence``."""
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
    """Names the session in the logs and summaries of both services; None where unknown."""
    began_utc_ns: int | None = None
    """UTC of session time zero since 1970, None where unknown."""
    complete: bool = True
    """False where the file was cut off and then recovered."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels that the frames carry."""
        return channels_of(self.frames.dtype)

    @property
    def samples_per_frame(self) -> int:
        """Samples of acceleration in a frame."""
        return samples_per_frame(self.frames.dtype)

    @property
    def time_s(self) -> FloatArray:
        """Session time of the frames, shape (n,); zero at the first."""
        time_ns = self.frames["time_ns"]
        return np.asarray((time_ns - time_ns[:1]) / 1e9, dtype=np.float64)

    @property
    def acceleration_time_s(self) -> FloatArray:
        """Session time of the samples of acceleration, shape (n k,)."""
        return sample_times(self.time_s, self.samples_per_frame, FRAME_PERIOD_S)

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the end of the last one's period."""
        return duration_s(self.frames)

    def vectors(self) -> dict[str, np.ndarray[Any, np.dtype[Any]]]:
        """Return each channel's vectors (n, 3), those of the acceleration sample by sample.

        These are (n k, 3); with k > 1 samples a frame their times, ``acceleration_time_s``
        (n k,), stand beside them.
        """
        vectors = {
            FIELD_OF_CHANNEL[channel]: self.frames[FIELD_OF_CHANNEL[channel]]
            for channel in self.channels
        }
        if self.samples_per_frame > 1:
            vectors["acceleration_m_s2"] = acceleration_samples(self.frames)
            vectors["acceleration_time_s"] = self.acceleration_time_s
        return vectors

    def columns(self) -> dict[str, np.ndarray[Any, np.dtype[Any]]]:
        """Return ``sequence``, ``time_s`` and each axis of each channel, of shape (n,) each.

        The names are those of the ``.csv`` and ``.parquet`` files (``position_x_mm``), so
        that ``pandas.DataFrame(session.columns())`` is the table that these hold. Where a frame
        has k > 1 samples of acceleration, each is a column: ``acceleration_x_m_s2[0]``, the
        oldest, and on; `vectors` has them one after the other.
        """
        columns: dict[str, np.ndarray[Any, np.dtype[Any]]] = {
            "sequence": self.frames["sequence"],
            "time_s": self.time_s,
        }
        for channel in self.channels:
            names = field_columns(channel, self.samples_per_frame)
            values = self.frames[FIELD_OF_CHANNEL[channel]].reshape(-1, len(names))
            columns |= zip(names, values.T, strict=True)
        return columns

    def __repr__(self) -> str:
        name = f" {self.path.name}" if self.path.name else ""
        parts = [f"{self.duration_s:.1f} s", f"{len(self.frames)} frames of "]
        parts[-1] += ", ".join(self.channels)
        missing = missing_frames(self.frames)
        counts = {"missing": missing, "models": len(self.models), "events": len(self.events)}
        parts += [f"{count} {what}" for what, count in counts.items() if count]
        if not self.complete:
            parts.append("cut off")
        return f"<RecordedSession{name}: {', '.join(parts)}>"


def missing_frames(frames: RecordArray) -> int:
    """Return how many frames are missing inside a session: the jumps in ``sequence``.

    A sequence that falls (the follower started again) is not a gap.
    """
    jumps = np.diff(frames["sequence"].astype(np.int64))
    return int(np.sum(jumps[jumps > 1] - 1))


def duration_s(frames: RecordArray) -> float:
    """Return the time from the first frame to the end of the last one's period."""
    if len(frames) == 0:
        return 0.0
    span_ns = int(frames["time_ns"][-1]) - int(frames["time_ns"][0])
    return (span_ns + FRAME_PERIOD_NS) / 1e9


def sample_times(times: _Times, samples_per_frame: int, period: float) -> _Times:
    """Return the times (n k,) of k samples a frame, the last of each at its frame's time (n,).

    The others are evenly spaced before it: over a period, or since the frame before if its time
    is closer. Whole numbers, as of nanoseconds, stay whole.
    """
    before = np.full_like(times, period)
    before[1:] = np.diff(times).clip(0, period)
    behind = before[:, None] * np.arange(samples_per_frame)[::-1]
    divide = np.floor_divide if times.dtype.kind == "i" else np.divide
    found: _Times = (times[:, None] - divide(behind, samples_per_frame)).ravel()
    return found


def sampled_parts(
    channels: Sequence[Channel], samples_per_frame: int
) -> list[tuple[Sequence[Channel], int]]:
    """Return the channels of one sample a frame, then those of several, with how many."""
    fast = [each for each in channels if each == "acceleration" and samples_per_frame > 1]
    slow = [each for each in channels if each not in fast]
    return [(part, k) for part, k in ((slow, 1), (fast, samples_per_frame)) if part]


def event_time_s(event: JsonObject) -> float:
    """Return an event's session time, 0 where it has none."""
    time_s = event.get("time_s")
    if isinstance(time_s, int | float) and math.isfinite(time_s):
        return float(time_s)
    return 0.0


def axis_columns(channel: Channel) -> tuple[str, str, str]:
    """Return the three column names of a channel, as in ``position_x_mm``."""
    unit = FIELD_OF_CHANNEL[channel].removeprefix(f"{channel}_")
    return (f"{channel}_x_{unit}", f"{channel}_y_{unit}", f"{channel}_z_{unit}")


def field_columns(channel: Channel, samples_per_frame: int) -> tuple[str, ...]:
    """Return the names of what a frame holds of a channel, in the order in which it holds it."""
    names = axis_columns(channel)
    if channel != "acceleration" or samples_per_frame == 1:
        return names
    return tuple(f"{name}[{sample}]" for sample in range(samples_per_frame) for name in names)


def to_json(value: object) -> str:
    """Return a value as JSON text that every reader accepts.

    NumPy scalars and arrays become numbers and lists, sets and tuples lists, numbers that
    JSON lacks (NaN, infinity) null, and every other object its text.
    """
    return json.dumps(_plain(value), allow_nan=False)


def _plain(value: object) -> object:
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, str | int | float) else str(value)
