"""Messages of a session file: Protobuf schemas, encoding and decoding.

The schemas travel inside the file, so that any MCAP tool decodes it; they are built here
from the channels of the session. The layout is in ``docs/reference/session-file.md``.
"""

import json
from collections.abc import Sequence
from typing import Any, Final, Self

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL, Channel, channels_of, frame_dtype

FRAME_BLOCK: Final = "mmt.FrameBlock"
PLOT_SAMPLE: Final = "mmt.PlotSample"
OUTPUT_BLOCK: Final = "mmt.OutputBlock"

EVENT_SCHEMA: Final = json.dumps({"type": "object", "title": "mmt.Event"}).encode()
"""JSON Schema of an event: an object; its keys are the recording program's own."""

_Field = descriptor_pb2.FieldDescriptorProto
_MISFITS = (DecodeError, AttributeError, TypeError, ValueError)
"""What decoding raises on fields that are absent, of another type or of another length."""

_MERGED_MESSAGES = 4096
"""Messages parsed in one call; limits the bytes that are joined at a time (4 MB)."""


def _schema(message: str, fields: Sequence[tuple[str, int, bool]]) -> bytes:
    """Return a serialized FileDescriptorSet with one message of (name, type, repeated)."""
    package, _, name = message.partition(".")
    described = descriptor_pb2.FileDescriptorProto(
        name=f"{package}/{name}.proto", package=package, syntax="proto3"
    )
    body = described.message_type.add(name=name)
    for number, (field, kind, repeated) in enumerate(fields, start=1):
        label = _Field.LABEL_REPEATED if repeated else _Field.LABEL_OPTIONAL
        body.field.add(name=field, number=number, type=kind, label=label)
    return bytes(descriptor_pb2.FileDescriptorSet(file=[described]).SerializeToString())


def frame_schema(channels: Sequence[Channel]) -> bytes:
    """Return the schema of ``mmt.FrameBlock`` with the fields of these channels."""
    fields = [("sequence", _Field.TYPE_UINT32, True), ("time_ns", _Field.TYPE_SFIXED64, True)]
    fields += [(FIELD_OF_CHANNEL[channel], _Field.TYPE_FLOAT, True) for channel in channels]
    return _schema(FRAME_BLOCK, fields)


def plot_schema(channels: Sequence[Channel]) -> bytes:
    """Return the schema of ``mmt.PlotSample``: scalars, which every plotting tool reads."""
    names = []
    for channel, quantity, unit in (("position", "position", "mm"), ("force", "force", "n")):
        if channel in channels:
            names += [f"{quantity}_{axis}_{unit}" for axis in "xyz"]
    if "acceleration" in channels:
        names.append("vibration_rms_m_s2")
    fields = [("time_ns", _Field.TYPE_SFIXED64, False)]
    return _schema(PLOT_SAMPLE, fields + [(name, _Field.TYPE_DOUBLE, False) for name in names])


def output_schema() -> bytes:
    """Return the schema of ``mmt.OutputBlock``."""
    return _schema(
        OUTPUT_BLOCK,
        [
            ("time_ns", _Field.TYPE_SFIXED64, False),
            ("mode", _Field.TYPE_STRING, False),
            ("vibration_m_s2", _Field.TYPE_FLOAT, True),
        ],
    )


def message_class(schema: bytes, name: str) -> Any:
    """Return the Protobuf class of a message that a serialized FileDescriptorSet describes.

    Raises
    ------
    InputError
        The schema does not parse or does not hold the message.
    """
    pool = descriptor_pool.DescriptorPool()
    try:
        for described in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
            pool.Add(described)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
    except (DecodeError, KeyError, TypeError) as error:
        raise InputError(f"the schema of {name} cannot be used: {error}") from error


class FrameCodec:
    """Turn blocks of frames into ``mmt.FrameBlock`` messages and back."""

    def __init__(self, schema: bytes) -> None:
        self._message = message_class(schema, FRAME_BLOCK)
        fields = self._message.DESCRIPTOR.fields_by_name
        self.channels = tuple(c for c in CHANNELS if FIELD_OF_CHANNEL[c] in fields)
        self.dtype = frame_dtype(self.channels)

    @classmethod
    def of_channels(cls, channels: Sequence[Channel]) -> Self:
        """Return the codec of the current layout for these channels."""
        return cls(frame_schema(channels))

    def encode(self, frames: RecordArray) -> bytes:
        """Return a block of frames (n,) as one message; about 12 us for n = 20."""
        values = {name: frames[name].ravel().tolist() for name in self.dtype.names or ()}
        return bytes(self._message(**values).SerializeToString())

    def decode(self, payloads: Sequence[bytes]) -> RecordArray:
        """Return the frames (n,) of many messages, in their order.

        Protobuf merges messages that are joined end to end by joining their repeated
        fields, so that thousands of blocks are parsed in one call.

        Raises
        ------
        InputError
            A message does not parse, or its fields differ in length.
        """
        joined = [
            b"".join(payloads[first : first + _MERGED_MESSAGES])
            for first in range(0, len(payloads), _MERGED_MESSAGES)
        ]
        return np.concatenate([np.zeros(0, dtype=self.dtype), *map(self._parse, joined)])

    def _parse(self, joined: bytes) -> RecordArray:
        try:
            message = self._message.FromString(joined)
            frames = np.zeros(len(message.sequence), dtype=self.dtype)
            for name in self.dtype.names or ():
                column = np.asarray(getattr(message, name), dtype=frames[name].dtype)
                frames[name] = column.reshape(frames[name].shape)
        except _MISFITS as error:
            raise InputError(f"blocks of frames do not fit their schema: {error}") from error
        return frames


class PlotCodec:
    """Condense a block of frames into one ``mmt.PlotSample``."""

    def __init__(self, channels: Sequence[Channel]) -> None:
        self._message = message_class(plot_schema(channels), PLOT_SAMPLE)

    def encode(self, frames: RecordArray) -> bytes:
        """Return the block's means and the root mean square of its vibration.

        Vibration is the acceleration without the block's mean, all axes together.
        """
        channels = channels_of(frames.dtype)
        values: dict[str, float] = {"time_ns": int(frames["time_ns"][0])}
        with np.errstate(all="ignore"):  # a faulty sensor's inf must not stop a recording
            for channel, unit in (("position", "mm"), ("force", "n")):
                if channel in channels:
                    mean = frames[f"{channel}_{unit}"].mean(axis=0, dtype=np.float64).tolist()
                    for axis, value in zip("xyz", mean, strict=True):
                        values[f"{channel}_{axis}_{unit}"] = value
            if "acceleration" in channels:
                acceleration = frames["acceleration_m_s2"].astype(np.float64)
                vibration = acceleration - acceleration.mean(axis=0)
                rms = np.sqrt(np.mean(np.sum(vibration**2, axis=1)))
                values["vibration_rms_m_s2"] = float(rms)
        return bytes(self._message(**values).SerializeToString())


class OutputCodec:
    """Turn the leader's output into ``mmt.OutputBlock`` messages and back."""

    def __init__(self, schema: bytes | None = None) -> None:
        self._message = message_class(schema or output_schema(), OUTPUT_BLOCK)

    def encode(self, time_ns: int, mode: str, vibration_m_s2: FloatArray) -> bytes:
        """Return samples (n,) that begin at `time_ns` as one message."""
        message = self._message(time_ns=time_ns, mode=mode, vibration_m_s2=vibration_m_s2.tolist())
        return bytes(message.SerializeToString())

    def decode(self, payload: bytes) -> tuple[str, FloatArray]:
        """Return the mode and the samples (n,) of one message.

        Raises
        ------
        InputError
            The message does not parse.
        """
        try:
            message = self._message.FromString(payload)
            return str(message.mode), np.asarray(message.vibration_m_s2, dtype=np.float64)
        except _MISFITS as error:
            raise InputError(f"the leader's output does not fit its schema: {error}") from error
