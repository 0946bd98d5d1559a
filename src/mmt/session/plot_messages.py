"""Messages of a session file for plotting tools: numbers and log messages.

mmt only writes these messages. ``docs/reference/session-file.md`` describes the layout.
"""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from google.protobuf import descriptor_pb2, timestamp_pb2

from mmt.core.arrays import RecordArray
from mmt.core.frames import FIELD_OF_CHANNEL, Channel, acceleration_samples, channels_of
from mmt.session.data import FRAME_PERIOD_NS, axis_columns, sample_times
from mmt.session.messages import Field, message_class, message_schema

PLOT_SAMPLE: Final = "mmt.PlotSample"
LOG: Final = "foxglove.Log"
SCALARS: Final = "mmt.Scalars"
ACCELERATION_SAMPLE: Final = "mmt.AccelerationSample"
VIBRATION_SAMPLE: Final = "mmt.VibrationSample"

_MEANS: Final[tuple[Channel, ...]] = ("position", "force")
"""Channels whose mean is in a plot sample; of acceleration it has the RMS of the vibration."""


def plot_schema(channels: Sequence[Channel]) -> bytes:
    """Return the schema of ``mmt.PlotSample``, whose fields are scalars for plotting tools."""
    names = [name for channel in _MEANS if channel in channels for name in axis_columns(channel)]
    if "acceleration" in channels:
        names.append("vibration_rms_m_s2")
    fields = [("time_ns", Field.TYPE_SFIXED64, False)]
    return message_schema(
        PLOT_SAMPLE, fields + [(name, Field.TYPE_DOUBLE, False) for name in names]
    )


def log_schema() -> bytes:
    """Return the schema of ``foxglove.Log``, which log panels show.

    Source: https://docs.foxglove.dev/docs/visualization/message-schemas/log.
    """
    timestamp = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(timestamp)
    described = descriptor_pb2.FileDescriptorProto(
        name="foxglove/Log.proto",
        package="foxglove",
        syntax="proto3",
        dependency=[timestamp.name],
    )
    body = described.message_type.add(name="Log")
    levels = body.enum_type.add(name="Level")
    for number, name in enumerate(("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")):
        levels.value.add(name=name, number=number)
    kinds: list[tuple[str, int, str | None]] = [
        ("timestamp", Field.TYPE_MESSAGE, ".google.protobuf.Timestamp"),
        ("level", Field.TYPE_ENUM, ".foxglove.Log.Level"),
        *((name, Field.TYPE_STRING, None) for name in ("message", "name", "file")),
        ("line", Field.TYPE_FIXED32, None),
    ]
    for number, (name, kind, of_type) in enumerate(kinds, start=1):
        label = Field.LABEL_OPTIONAL
        body.field.add(name=name, number=number, type=kind, label=label, type_name=of_type)
    files = descriptor_pb2.FileDescriptorSet(file=[timestamp, described])
    return bytes(files.SerializeToString())


def scalars_schema(message: str, channels: Sequence[Channel]) -> bytes:
    """Return the schema of a message with one sample: a field for each axis of each channel."""
    names = [name for channel in channels for name in axis_columns(channel)]
    fields = [("time_ns", Field.TYPE_SFIXED64, False)]
    return message_schema(message, fields + [(name, Field.TYPE_FLOAT, False) for name in names])


def vibration_sample_schema() -> bytes:
    """Return the schema of ``mmt.VibrationSample``: one sample of the leader's output."""
    fields = [("time_ns", Field.TYPE_SFIXED64, False), ("vibration_m_s2", Field.TYPE_FLOAT, False)]
    return message_schema(VIBRATION_SAMPLE, fields)


class PlotCodec:
    """Condense a block of frames into one ``mmt.PlotSample``."""

    def __init__(self, channels: Sequence[Channel]) -> None:
        self._message = message_class(plot_schema(channels), PLOT_SAMPLE)

    def encode(self, frames: RecordArray) -> bytes:
        """Encode a block's means and the RMS of its vibration, at the first frame's time.

        Vibration is the acceleration without the block's mean, over all axes together.
        """
        channels = channels_of(frames.dtype)
        values: dict[str, float] = {"time_ns": int(frames["time_ns"][0])}
        with np.errstate(all="ignore"):  # a faulty sensor's inf must not stop a recording
            for channel in _MEANS:
                if channel in channels:
                    mean = frames[FIELD_OF_CHANNEL[channel]].mean(axis=0, dtype=np.float64)
                    values |= zip(axis_columns(channel), mean.tolist(), strict=True)
            if "acceleration" in channels:
                acceleration = acceleration_samples(frames).astype(np.float64)
                vibration = acceleration - acceleration.mean(axis=0)
                rms = np.sqrt(np.mean(np.sum(vibration**2, axis=1)))
                values["vibration_rms_m_s2"] = float(rms)
        return bytes(self._message(**values).SerializeToString())


class LogCodec:
    """Turn sentences into ``foxglove.Log`` messages."""

    def __init__(self) -> None:
        self._message = message_class(log_schema(), LOG)

    def encode(self, utc_ns: int, sentence: str) -> bytes:
        """Encode a sentence as a message of level INFO at `utc_ns`, in ns since 1970."""
        message = self._message(level=2, message=sentence, name="mmt")
        message.timestamp.seconds, message.timestamp.nanos = divmod(utc_ns, 1_000_000_000)
        return bytes(message.SerializeToString())


class ScalarCodec:
    """Turn each sample of channels into a message of `scalars_schema`."""

    def __init__(self, message: str, channels: Sequence[Channel]) -> None:
        self._message = message_class(scalars_schema(message, channels), message)
        self._fields = {FIELD_OF_CHANNEL[channel]: axis_columns(channel) for channel in channels}

    def encode(self, frames: RecordArray) -> Iterator[tuple[int, int, bytes]]:
        """Yield sequence of the frame, time (ns) and message for each sample of frames (n,)."""
        columns = [
            frames[field].reshape(-1, len(names)).tolist() for field, names in self._fields.items()
        ]
        several = len(columns[0]) // len(frames)
        times_ns = sample_times(frames["time_ns"], several, FRAME_PERIOD_NS).tolist()
        sequence = frames["sequence"].tolist()
        for place, vectors in enumerate(zip(*columns, strict=True)):
            values: dict[str, float] = {"time_ns": times_ns[place]}
            for names, vector in zip(self._fields.values(), vectors, strict=True):
                values |= zip(names, vector, strict=True)
            message = self._message(**values)
            yield sequence[place // several], message.time_ns, bytes(message.SerializeToString())


class VibrationCodec:
    """Turn each sample of the leader's output into a ``mmt.VibrationSample`` message."""

    def __init__(self) -> None:
        self._message = message_class(vibration_sample_schema(), VIBRATION_SAMPLE)

    def encode(self, time_ns: int, vibration_m_s2: float) -> bytes:
        """Return one sample as a message."""
        message = self._message(time_ns=time_ns, vibration_m_s2=vibration_m_s2)
        return bytes(message.SerializeToString())
