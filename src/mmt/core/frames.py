"""Records that the two services exchange: frames, commands, and those of force feedback.

Each is a NumPy structured dtype, and a block of frames is an array of shape (n,). All numbers are
little-endian, so that the bytes of a block are the same on the wire and in a file on every machine.
The records of force feedback are sent only with the methods that need them. The layouts are in
``docs/reference/wire.md``.

Motion and force come once a frame. Acceleration may come at k times that rate, k samples a frame,
evenly spaced, the last of them at the frame's own time. The tool's orientation is in frames only
where a scene asks for it.
"""

import struct
from collections.abc import Iterable
from typing import Annotated, Final, Literal, Protocol

import numpy as np
from annotated_types import Ge, Le, MultipleOf

from mmt.core.arrays import RecordArray, SingleArray
from mmt.core.errors import InputError

_RATE_TOLERANCE: Final = 0.1
"""Relative tolerance of a frame rate: more than jitter and drift, less than another rate."""

_LESS: Final = 0.95
"""Share of a rate below which another one is lower; crystals and resonators deviate by less."""

FRAMES_HZ: Final = 1000
"""Frames a second."""

MOST_SAMPLES: Final = 10
"""Most samples of acceleration in a frame."""

LARGEST_QUANTITY: Final = 1e6
"""Largest norm of a record's quantities: a kilometre (mm), or the weight of a hundred tons (N);
more is a fault, not a measurement."""

AccelerationRateHz = Annotated[
    int, Ge(FRAMES_HZ), Le(FRAMES_HZ * MOST_SAMPLES), MultipleOf(FRAMES_HZ)
]
"""Samples of acceleration a second; a whole number in each frame."""

Channel = Literal["position", "force", "acceleration", "orientation"]

CHANNELS: Final[tuple[Channel, ...]] = ("position", "force", "acceleration")
"""The usual channels, in the order of a frame's fields."""

ALL_CHANNELS: Final[tuple[Channel, ...]] = (*CHANNELS, "orientation")
"""All channels that a frame may have, in the order of its fields."""

FIELD_OF_CHANNEL: Final[dict[Channel, str]] = {
    "position": "position_mm",
    "force": "force_n",
    "acceleration": "acceleration_m_s2",
    "orientation": "orientation",
}
"""The field's name carries the unit; an orientation is a unit quaternion and has none."""

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

ENERGY: Final = "energy"
"""Both ways, with ``method = "passive"``: energy that entered through the sender's port."""

ENERGY_DTYPE: Final = np.dtype([("sequence", "<u4"), ("time_ns", "<i8"), ("energy_j", "<f8", (3,))])
"""Energy (J) of each axis since the sender began; it never falls."""

CONTACT: Final = "contact"
"""Follower to leader, with ``method = "model"``: samples from which the contact is estimated."""

CONTACT_DTYPE: Final = np.dtype(
    [
        ("sequence", "<u4"),
        ("time_ns", "<i8"),
        ("command_mm", "<f4", (3,)),
        ("position_mm", "<f4", (3,)),
        ("force_n", "<f4", (3,)),
    ]
)
"""A tick of the follower: the command given to the robot, the tool's position, and the force of
the surface on it."""

CONTACT_GATHERED: Final = 5
"""Contact samples in one message."""


def ordered_channels(channels: Iterable[str]) -> tuple[Channel, ...]:
    """Return the channels in the frame's order, each once.

    Raises
    ------
    InputError
        A name is no channel, or no name is given.
    """
    wanted = set(channels)
    unknown = wanted - set(ALL_CHANNELS)
    if unknown or not wanted:
        given = ", ".join(sorted(unknown)) or "none"
        raise InputError(f"channels: {given} given, allowed are {', '.join(ALL_CHANNELS)}")
    return tuple(channel for channel in ALL_CHANNELS if channel in wanted)


def axes_of(channel: Channel) -> str:
    """Return the names of a channel's components, in their order: "xyz" or "wxyz"."""
    return "wxyz" if channel == "orientation" else "xyz"


def frame_dtype(
    channels: Iterable[str] = CHANNELS, samples_per_frame: int = 1
) -> np.dtype[np.void]:
    """Return the packed little-endian dtype of a frame with these channels.

    Fields: ``sequence`` (u4, counts from 0 and never repeats within a session),
    ``time_ns`` (i8, the follower's monotonic clock), then of the chosen channels
    ``position_mm``, ``force_n``, ``acceleration_m_s2``, each of shape (3,), f4. With k > 1
    samples a frame ``acceleration_m_s2`` is (k, 3), the oldest first. ``orientation`` (4,), f4, is
    the unit quaternion (w, x, y, z) that turns vectors from the tool's axes into those of the
    other channels.
    """
    fields: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = [
        ("sequence", "<u4"),
        ("time_ns", "<i8"),
    ]
    for channel in ordered_channels(channels):
        several = samples_per_frame > 1 and channel == "acceleration"
        width = len(axes_of(channel))
        shape = (samples_per_frame, width) if several else (width,)
        fields.append((FIELD_OF_CHANNEL[channel], "<f4", shape))
    return np.dtype(fields)


def frame_struct(dtype: np.dtype[np.void]) -> struct.Struct:
    """Return the struct that packs a frame of this dtype: sequence, time, then each value.

    Packing is several times as fast as making an array from tuples.
    """
    number = dtype[-1].base
    count = (dtype.itemsize - struct.calcsize("<Iq")) // number.itemsize
    return struct.Struct(f"<Iq{count}{number.char}")


def samples_per_frame(dtype: np.dtype[np.void]) -> int:
    """Return how many samples of acceleration a frame of this dtype carries, 1 without any."""
    if FIELD_OF_CHANNEL["acceleration"] not in (dtype.names or ()):
        return 1
    shape = dtype[FIELD_OF_CHANNEL["acceleration"]].shape
    return int(shape[0]) if len(shape) == 2 else 1


def acceleration_samples(frames: RecordArray) -> SingleArray:
    """Return the acceleration of frames (n,) sample by sample, (n k, 3) in m/s2.

    The result may be a view of the frames or a copy; do not write to it.
    """
    field: SingleArray = frames[FIELD_OF_CHANNEL["acceleration"]]
    return field.reshape(-1, 3)


def channels_of(dtype: np.dtype[np.void]) -> tuple[Channel, ...]:
    """Return the channels that a frame dtype carries."""
    names = dtype.names or ()
    return tuple(channel for channel in ALL_CHANNELS if FIELD_OF_CHANNEL[channel] in names)


def check_frames(frames: object) -> None:
    """Check that a value is an array of frames (n,) with at least the usual channels.

    Raises
    ------
    InputError
        The value is no such array, or lacks a channel.
    """
    names = (frames.dtype.names or ()) if isinstance(frames, np.ndarray) else ()
    shape = getattr(frames, "shape", ())
    if "sequence" not in names or len(shape) != 1:
        raise InputError(
            f"frames are of type {type(frames).__name__}, shape {shape}: a structured array (n,) "
            "is needed, as mmt.read_session(...).frames is"
        )
    missing = [channel for channel in CHANNELS if FIELD_OF_CHANNEL[channel] not in names]
    if missing:
        raise InputError(
            f"frames without {', '.join(missing)}: {', '.join(CHANNELS)} are needed; add them to "
            "the scene, or map them when a file is imported (mmt session inspect FILE tells how)"
        )


def check_frame_rate(frames: RecordArray, rate_hz: float) -> None:
    """Check by the time stamps of frames (n,) that consecutive ones are a period apart.

    Raises
    ------
    InputError
        The median distance differs from the period by more than a tenth.
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


def missing_band(rate_hz: float, samples_hz: float) -> str:
    """Return a warning if a sensor's rate is too low for the rate of the samples, else ""."""
    if rate_hz >= _LESS * samples_hz:
        return ""
    return (
        f"gives {rate_hz:.0f} samples a second, the scene takes {samples_hz:.0f}: nothing above "
        f"{rate_hz / 2:.0f} Hz is in its acceleration"
    )


def check_acceleration_rate(rate_hz: int) -> None:
    """Check that ``--acceleration-rate`` gives a whole number of samples a frame.

    Raises
    ------
    InputError
        The rate is not a multiple of the frame rate, or is out of range.
    """
    if rate_hz not in range(FRAMES_HZ, FRAMES_HZ * MOST_SAMPLES + 1, FRAMES_HZ):
        raise InputError(
            f"--acceleration-rate {rate_hz}: it is a multiple of {FRAMES_HZ}, to "
            f"{FRAMES_HZ * MOST_SAMPLES}"
        )


def empty_frames(
    count: int, channels: Iterable[str] = CHANNELS, samples_per_frame: int = 1
) -> RecordArray:
    """Return `count` frames of zeros."""
    return np.zeros(count, dtype=frame_dtype(channels, samples_per_frame))


class FeedbackSide(Protocol):
    """One side of a force-feedback method, as the link uses it."""

    @property
    def event(self) -> str | None:
        """Name of the further event between the two sides, or None if frames are enough."""

    @property
    def dtype(self) -> "np.dtype[np.void] | None":
        """Dtype of that event's records."""

    def on_records(self, records: RecordArray) -> None:
        """Handle validated records (n,) of the further event."""

    def restart(self) -> None:
        """Prepare for a new connection, perhaps of a restarted peer."""
