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
from mmt.session.mcap.messages import Codec, Field, message_schema

PLOT_SAMPLE: Final = "mmt.PlotSample"
LOG: Final = "foxglove.Log"
SCALARS: Final = "mmt.Scalars"
ACCELERATION_SAMPLE: Final = "mmt.AccelerationSample"
VIBRATION_SAMPLE: Final = "mmt.VibrationSample"

_MEANS: Final[tuple[Channel, ...]] = ("position", "force")
"""Channels whose mean is in a plot sample; of acceleration it has the RMS of the vibration."""
_TIMESTAMP: Final = ".google.protobuf.Timestamp"
_TIME: Final = ("time_ns", Field.TYPE_SFIXED64, False)


def log_schema() -> bytes:
    """Return the schema of ``foxglove.Log``, which log panels show.

    Source: https://docs.foxglove.dev/docs/visualization/message-schemas/log.
    """
    kinds = {"timestamp": Field.TYPE_MESSAGE, "level": Field.TYPE_ENUM}
    kinds |= dict.fromkeys(("message", "name", "file"), Field.TYPE_STRING)
    fields = [(name, kind, False) for name, kind in {**kinds, "line": Field.TYPE_FIXED32}.items()]
    files = descriptor_pb2.FileDescriptorSet()
    timestamp_pb2.DESCRIPTOR.CopyToProto(files.file.add())
    files.MergeFromString(message_schema(LOG, fields))
    files.file[1].dependency.append(timestamp_pb2.DESCRIPTOR.name)
    body = files.file[1].message_type[0]
    body.field[0].type_name, body.field[1].type_name = _TIMESTAMP, f".{LOG}.Level"
    levels = body.enum_type.add(name="Level")
    for number, name in enumerate(("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")):
        levels.value.add(name=name, number=number)
    return bytes(files.SerializeToString())


class PlotCodec(Codec):
    """Condense a block of frames into one ``mmt.PlotSample``: scalars for plotting tools."""

    def __init__(self, channels: Sequence[Channel]) -> None:
        names = [n for channel in _MEANS if channel in channels for n in axis_columns(channel)]
        if "acceleration" in channels:
            names.append("vibration_rms_m_s2")
        fields = [_TIME, *((name, Field.TYPE_DOUBLE, False) for name in names)]
        super().__init__(PLOT_SAMPLE, message_schema(PLOT_SAMPLE, fields))

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
        return self.pack(**values)


class LogCodec(Codec):
    """Turn sentences into ``foxglove.Log`` messages."""

    def __init__(self) -> None:
        super().__init__(LOG, log_schema())

    def encode(self, utc_ns: int, sentence: str) -> bytes:
        """Encode a sentence as a message of level INFO at `utc_ns`, in ns since 1970."""
        message = self.message(level=2, message=sentence, name="mmt")
        message.timestamp.seconds, message.timestamp.nanos = divmod(utc_ns, 1_000_000_000)
        return bytes(message.SerializeToString())


class ScalarCodec(Codec):
    """Turn each sample of channels into a message with a field for each axis of each channel."""

    def __init__(self, message: str, channels: Sequence[Channel]) -> None:
        self._fields = {FIELD_OF_CHANNEL[channel]: axis_columns(channel) for channel in channels}
        names = [name for columns in self._fields.values() for name in columns]
        fields = [_TIME, *((name, Field.TYPE_FLOAT, False) for name in names)]
        super().__init__(message, message_schema(message, fields))

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
            yield sequence[place // several], times_ns[place], self.pack(**values)


def vibration_codec() -> Codec:
    """Return the codec of ``mmt.VibrationSample``: one sample of the leader's output."""
    fields = [_TIME, ("vibration_m_s2", Field.TYPE_FLOAT, False)]
    return Codec(VIBRATION_SAMPLE, message_schema(VIBRATION_SAMPLE, fields))
