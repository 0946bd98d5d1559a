"""A recorded session in memory: the type that readers return and writers take."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray, IntArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import (
    FIELD_OF_CHANNEL,
    FRAMES_HZ,
    Channel,
    acceleration_samples,
    axes_of,
    channels_of,
    empty_frames,
    samples_per_frame,
)
from mmt.core.output.plottable import Plottable

FRAME_PERIOD_NS = 1_000_000
"""Frames come at 1 kHz."""
FRAME_PERIOD_S = 1e-3
_LONGEST_S = 1e8  # three years

_COMPARED = ("time_ns", "offset_ns", "drift_ppm", "uncertainty_ns")

_Times = TypeVar("_Times", IntArray, FloatArray)

JsonObject = Mapping[str, Any]
"""A JSON object whose keys depend on the program that wrote it."""


@dataclass(frozen=True, eq=False)
class OutputBlock:
    """Consecutive samples that the leader wrote to its actuator."""

    time_s: float
    """Session time of the first sample."""
    mode: str
    """The leader's name for the source of the vibration."""
    vibration_m_s2: FloatArray
    """Shape (n,), stored in single precision."""
    samples_per_frame: int = 1
    """Samples per frame, as many as the session has of acceleration."""

    @property
    def rate_hz(self) -> float:
        """Sample rate (Hz)."""
        return FRAMES_HZ * self.samples_per_frame

    @property
    def end_s(self) -> float:
        """Session time of the end of the last sample's period."""
        return self.time_s + len(self.vibration_m_s2) / self.rate_hz


@dataclass(frozen=True, eq=False, repr=False)
class RecordedSession(Plottable):
    """One recorded session in memory.

    Session time, ``time_s`` below, is zero at the first frame.

    Examples
    --------
    >>> import mmt
    >>> frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=2.0)
    >>> mmt.RecordedSession(frames)
    <RecordedSession: 2.0 s, 2000 frames of position, force, acceleration>
    """

    frames: RecordArray
    """Shape (n,), with the dtype of `mmt.core.frames.frame_dtype`: ``sequence``, ``time_ns`` and,
    for the recorded channels, ``position_mm``, ``force_n`` and ``acceleration_m_s2``, (3,) each,
    and ``orientation`` (4,).
    The acceleration is (k, 3) if a frame has k samples of it. Missing frames are jumps in
    ``sequence``."""
    scene: JsonObject | None = None
    """The resolved scene, or None if the file holds none."""
    annotations: bytes = b""
    """Data that the follower attached to the session, such as the simulated truth."""
    models: Sequence[tuple[float, bytes]] = ()
    """Texture models (bytes of a ``.npz``) with the session time of each, in order."""
    events: Sequence[JsonObject] = ()
    """Events in order, each with its ``time_s``."""
    outputs: Sequence[OutputBlock] = ()
    """Vibration that the leader wrote to its actuator."""
    path: Path = field(default=Path())
    """File from which the session was read."""
    session_id: str | None = None
    """Identifies the session in the logs and summaries of both services; None if unknown."""
    began_utc_ns: int | None = None
    """UTC of session time zero, in ns since 1970, or None if unknown."""
    complete: bool = True
    """False if the file was cut off or damaged, also if it was then recovered."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels that the frames carry."""
        return channels_of(self.frames.dtype)

    @property
    def samples_per_frame(self) -> int:
        """Samples of acceleration per frame."""
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
        """Time from the first frame to the end of the last frame's period."""
        return duration_s(self.frames)

    def vectors(self) -> dict[str, np.ndarray[Any, np.dtype[Any]]]:
        """Return each channel's vectors, (n, 3), or quaternions, (n, 4), by field name.

        With k > 1 samples of acceleration per frame, the acceleration has the shape (n k, 3), and
        ``acceleration_time_s`` (n k,) has the time of each sample.
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

        ``pandas.DataFrame(session.columns())`` is the table of the ``.csv`` and ``.parquet``
        files, with their column names (``position_x_mm``). If a frame has k > 1 samples of
        acceleration, each sample has its own columns, from ``acceleration_x_m_s2[0]``, the
        oldest. `vectors` returns these samples one after the other.
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


def check_recording(session: object) -> None:
    """Raise InputError if something else, such as frames or a path, is given as a session."""
    if not hasattr(session, "samples_per_frame"):
        raise InputError(
            f"session is of type {type(session).__name__}: what mmt.read_session or "
            "mmt.import_session returns is needed, or mmt.RecordedSession(frames)"
        )


def frames_of(
    sequence: npt.ArrayLike,
    time_ns: npt.ArrayLike,
    values: Mapping[Channel, np.ndarray[Any, np.dtype[Any]]],
    samples_per_frame: int = 1,
) -> RecordArray:
    """Return frames (n,) with these channels' values, of any shape that has as many numbers."""
    frames = empty_frames(np.size(sequence), values, samples_per_frame)
    frames["sequence"], frames["time_ns"] = sequence, time_ns
    for channel, vectors in values.items():
        field = frames[FIELD_OF_CHANNEL[channel]]
        field[...] = vectors.reshape(field.shape)
    return frames


def missing_frames(frames: RecordArray) -> int:
    """Return how many frames are missing within a session, by the jumps in ``sequence``.

    A decrease of ``sequence`` (the follower restarted) does not count as missing frames.
    """
    jumps = np.diff(frames["sequence"].astype(np.int64))
    return int(np.sum(jumps[jumps > 1] - 1))


def duration_s(frames: RecordArray) -> float:
    """Return the time from the first frame to the end of the last frame's period."""
    if len(frames) == 0:
        return 0.0
    span_ns = int(frames["time_ns"][-1]) - int(frames["time_ns"][0])
    return (span_ns + FRAME_PERIOD_NS) / 1e9


def sample_times(times: _Times, samples_per_frame: int, period: float) -> _Times:
    """Return the times (n k,) of k samples per frame from the times (n,) of the frames.

    The last sample of a frame has the frame's time. The others are evenly spaced before it, over
    `period`, or since the previous frame if that is closer. Integer times give integers.
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
    """Group channels by samples per frame: those with one, then those with several."""
    fast = [each for each in channels if each == "acceleration" and samples_per_frame > 1]
    slow = [each for each in channels if each not in fast]
    return [(part, k) for part, k in ((slow, 1), (fast, samples_per_frame)) if part]


def event_time_s(event: JsonObject) -> float:
    """Return an event's session time, or 0 if the event has none, or an impossible one."""
    time_s = event.get("time_s")
    if isinstance(time_s, int | float) and abs(time_s) < _LONGEST_S:  # false for NaN
        return float(time_s)
    return 0.0


def compares_clocks(event: JsonObject) -> bool:
    """Return whether an event is a usable comparison of the follower's and the leader's clock."""
    values = [event.get(f"clock_{key}") for key in _COMPARED]
    return all(isinstance(value, int | float) and math.isfinite(value) for value in values)


def clock_offset_ns(comparison: JsonObject, time_ns: int | IntArray) -> IntArray:
    """Return the follower's clock minus the leader's at times by the leader's clock, in ns.

    Parameters
    ----------
    comparison
        See `compares_clocks`.
    time_ns
        Any shape, which is that of the result.
    """
    since_ns = np.asarray(time_ns) - int(comparison["clock_time_ns"])
    gained_ns = np.rint(float(comparison["clock_drift_ppm"]) / 1e6 * since_ns).astype(np.int64)
    return np.asarray(int(comparison["clock_offset_ns"]) + gained_ns)


def axis_columns(channel: Channel) -> tuple[str, ...]:
    """Return the column names of a channel's components, as in ``position_x_mm``."""
    unit = FIELD_OF_CHANNEL[channel].removeprefix(channel)
    return tuple(f"{channel}_{axis}{unit}" for axis in axes_of(channel))


def field_columns(channel: Channel, samples_per_frame: int) -> tuple[str, ...]:
    """Return the column names of a channel's values, in their order within a frame."""
    names = axis_columns(channel)
    if channel != "acceleration" or samples_per_frame == 1:
        return names
    return tuple(f"{name}[{sample}]" for sample in range(samples_per_frame) for name in names)


def to_json(value: object) -> str:
    """Return a value as standard JSON text, see `json_value`."""
    return json.dumps(json_value(value), allow_nan=False)


def json_value(value: object) -> Any:
    """Return a value as standard JSON can hold it.

    NumPy scalars become numbers, arrays, sets and tuples become lists, NaN and infinity become
    None, and any other object becomes its `str`.
    """
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [json_value(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, str | int | float) else str(value)
