"""The 1 kHz frame and blocks of frames: one NumPy structured dtype.

A block of frames is a structured array of shape (n,). All numbers are little-endian, so
that the bytes of a block are the same on the wire and in a file on every machine.
"""

from collections.abc import Iterable
from typing import Final, Literal, TypeVar

import numpy as np

from mmt.core.arrays import IntArray, RecordArray
from mmt.core.errors import InputError

_RATE_TOLERANCE: Final = 0.1
"""Jitter of stamps and a drifting clock are far less, another rate is more."""

SEQUENCES: Final = 2**32
"""Sequence numbers are 32 bits: behind the last one comes 0 again, after 49 days at 1 kHz."""

Number = TypeVar("Number", int, IntArray)

Channel = Literal["position", "force", "acceleration"]

CHANNELS: Final[tuple[Channel, ...]] = ("position", "force", "acceleration")
"""Every channel in the order in which it stands in a frame."""

FIELD_OF_CHANNEL: Final[dict[Channel, str]] = {
    "position": "position_mm",
    "force": "force_n",
    "acceleration": "acceleration_m_s2",
}
"""The field's name carries the unit."""

COMMAND_DTYPE: Final = np.dtype(
    [
        ("sequence", "<u4"),
        ("time_ns", "<i8"),
        ("echo_time_ns", "<i8"),
        ("echo_age_ns", "<i8"),
        ("position_mm", "<f4", (3,)),
    ]
)
"""A motion command: the leader's sequence number and monotonic time, the follower's time
of the newest frame seen by the leader with its age (zero before the first frame), and the
position that the follower is to take."""


def steps_ahead(number: Number, newest: int) -> Number:
    """Return how far numbers are ahead of the newest one, negative if they are behind.

    They are taken modulo `SEQUENCES`, and the shorter way counts (RFC 1982).
    """
    return (number - newest + SEQUENCES // 2) % SEQUENCES - SEQUENCES // 2


def ordered_channels(channels: Iterable[str]) -> tuple[Channel, ...]:
    """Return the channels in the frame's order, each once.

    Raises
    ------
    InputError
        A name is no channel, or there is none at all.
    """
    wanted = set(channels)
    unknown = wanted - set(CHANNELS)
    if unknown or not wanted:
        given = ", ".join(sorted(unknown)) or "none"
        raise InputError(f"channels: {given} given, allowed are {', '.join(CHANNELS)}")
    return tuple(channel for channel in CHANNELS if channel in wanted)


def frame_dtype(channels: Iterable[str] = CHANNELS) -> np.dtype[np.void]:
    """Return the packed little-endian dtype of a frame with these channels.

    Fields: ``sequence`` (u4, counts from 0 and never repeats within a session),
    ``time_ns`` (i8, the follower's monotonic clock), then of the chosen channels
    ``position_mm``, ``force_n``, ``acceleration_m_s2``, each of shape (3,), f4.
    """
    fields: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = [
        ("sequence", "<u4"),
        ("time_ns", "<i8"),
    ]
    fields += [(FIELD_OF_CHANNEL[channel], "<f4", (3,)) for channel in ordered_channels(channels)]
    return np.dtype(fields)


def channels_of(dtype: np.dtype[np.void]) -> tuple[Channel, ...]:
    """Return the channels that a frame dtype carries."""
    names = dtype.names or ()
    return tuple(channel for channel in CHANNELS if FIELD_OF_CHANNEL[channel] in names)


def check_frames(frames: object, channels: Iterable[Channel] = CHANNELS) -> None:
    """Check that these are frames (n,) with at least some channels.

    Raises
    ------
    InputError
        They are no such array, or lack a channel.
    """
    names = (frames.dtype.names or ()) if isinstance(frames, np.ndarray) else ()
    shape = getattr(frames, "shape", ())
    if "sequence" not in names or len(shape) != 1:
        raise InputError(
            f"frames are of type {type(frames).__name__}, shape {shape}: a structured array (n,) "
            "is needed, as mmt.read_session(...).frames is"
        )
    missing = [channel for channel in channels if FIELD_OF_CHANNEL[channel] not in names]
    if missing:
        raise InputError(
            f"frames without {', '.join(missing)}: {', '.join(channels)} are needed; add the "
            "channels to the scene"
        )


def check_frame_rate(frames: RecordArray, rate_hz: float) -> None:
    """Check that frames (n,) which follow each other are a period apart by their time stamps.

    Raises
    ------
    InputError
        By half of them the rate is another one, by more than a tenth.
    """
    following = np.diff(frames["sequence"].astype(np.int64)) == 1
    steps_ns = np.diff(frames["time_ns"].astype(np.int64))[following]
    step_ns = float(np.median(steps_ns)) if len(steps_ns) else 0.0
    if step_ns > 0.0 and abs(1e-9 * step_ns * rate_hz - 1.0) > _RATE_TOLERANCE:
        raise InputError(
            f"the frames are {1e-6 * step_ns:g} ms apart by their time stamps, which is "
            f"{1e9 / step_ns:g} Hz: {rate_hz:g} Hz are needed, and 'mmt session import' resamples "
            "a table of another rate"
        )


def empty_frames(count: int, channels: Iterable[str] = CHANNELS) -> RecordArray:
    """Return `count` frames of zeros."""
    return np.zeros(count, dtype=frame_dtype(channels))
