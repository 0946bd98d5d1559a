"""Messages of a session file: Protobuf schemas, encoding and decoding.

The schemas are built from the session's channels and stored in the file, so that any MCAP tool
can decode it. ``docs/reference/session-file.md`` describes the layout.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from graphlib import CycleError, TopologicalSorter
from typing import Any, Final

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import ALL_CHANNELS, FIELD_OF_CHANNEL, Channel, frame_dtype
from mmt.session.data import JsonObject, event_time_s

FRAME_BLOCK: Final = "mmt.FrameBlock"
OUTPUT_BLOCK: Final = "mmt.OutputBlock"

EVENT: Final = "mmt.Event"

Field: Final = descriptor_pb2.FieldDescriptorProto
_MISFITS = (DecodeError, AttributeError, TypeError, ValueError)
"""Exceptions that decoding raises if a field is absent or has another type or length."""


@contextmanager
def _fitting(else_told: str) -> Iterator[None]:
    try:
        yield
    except _MISFITS as error:
        raise InputError(f"{else_told}: {error}") from error


_MERGED_MESSAGES = 4096
"""Messages parsed in one call; limits the bytes that are joined (4 MB)."""


def message_schema(message: str, fields: Sequence[tuple[str, int, bool]]) -> bytes:
    """Return a serialized FileDescriptorSet of one message; a field is (name, type, repeated)."""
    package, _, name = message.partition(".")
    described = descriptor_pb2.FileDescriptorProto(
        name=f"{package}/{name}.proto", package=package, syntax="proto3"
    )
    body = described.message_type.add(name=name)
    for number, (field, kind, repeated) in enumerate(fields, start=1):
        label = Field.LABEL_REPEATED if repeated else Field.LABEL_OPTIONAL
        body.field.add(name=field, number=number, type=kind, label=label)
    return bytes(descriptor_pb2.FileDescriptorSet(file=[described]).SerializeToString())


def frame_schema(channels: Sequence[Channel]) -> bytes:
    """Return the schema of ``mmt.FrameBlock`` with the fields of these channels."""
    fields = [("sequence", Field.TYPE_UINT32, True), ("time_ns", Field.TYPE_SFIXED64, True)]
    fields += [(FIELD_OF_CHANNEL[channel], Field.TYPE_FLOAT, True) for channel in channels]
    return message_schema(FRAME_BLOCK, fields)


def message_class(schema: bytes, name: str) -> Any:
    """Return the Protobuf class of a message in a serialized FileDescriptorSet.

    Raises
    ------
    InputError
        The schema does not parse or does not hold the message.
    """
    pool = descriptor_pool.DescriptorPool()
    try:
        files = {
            file.name: file for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file
        }
        # many writers put a file before its dependencies
        for each in TopologicalSorter({n: f.dependency for n, f in files.items()}).static_order():
            if each in files:
                pool.Add(files[each])
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
    except (DecodeError, KeyError, TypeError, CycleError) as error:
        raise InputError(f"the schema of {name} cannot be used: {error}") from error


class Codec:
    """Encodes messages of one type.

    Parameters
    ----------
    name
        Name of the message.
    schema
        Serialized FileDescriptorSet that holds it.
    """

    def __init__(self, name: str, schema: bytes) -> None:
        self.name, self.schema = name, schema
        self.message = message_class(schema, name)

    def pack(self, **fields: Any) -> bytes:
        """Return a message with these fields."""
        return bytes(self.message(**fields).SerializeToString())


class FrameCodec(Codec):
    """Turn blocks of frames into ``mmt.FrameBlock`` messages and back.

    Parameters
    ----------
    layout
        Schema of the messages, which defines the channels; or these, for the current layout.
    samples_per_frame
        Samples of acceleration, and of the leader's output, per frame.
    """

    def __init__(self, layout: bytes | Sequence[Channel], samples_per_frame: int = 1) -> None:
        schema = layout if isinstance(layout, bytes) else frame_schema(layout)
        super().__init__(FRAME_BLOCK, schema)
        fields = self.message.DESCRIPTOR.fields_by_name
        self.channels = tuple(c for c in ALL_CHANNELS if FIELD_OF_CHANNEL[c] in fields)
        self.samples_per_frame = samples_per_frame
        self.dtype = frame_dtype(self.channels, samples_per_frame)

    def encode(self, frames: RecordArray) -> bytes:
        """Encode a block of frames (n,) as one message; about 12 us for n = 20."""
        return self.pack(**{name: frames[name].ravel().tolist() for name in self.dtype.names or ()})

    def decode(self, payloads: Sequence[bytes]) -> RecordArray:
        """Decode many messages and return their frames (n,), in order.

        Protobuf parses concatenated messages as one message with concatenated repeated fields,
        so one call parses thousands of blocks.

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
        with _fitting("blocks of frames do not fit their schema"):
            message = self.message.FromString(joined)
            frames = np.zeros(len(message.sequence), dtype=self.dtype)
            for name in self.dtype.names or ():
                column = np.asarray(getattr(message, name), dtype=frames[name].dtype)
                frames[name] = column.reshape(frames[name].shape)
        return frames


class OutputCodec(Codec):
    """Turn the leader's output into ``mmt.OutputBlock`` messages and back."""

    def __init__(self, schema: bytes | None = None) -> None:
        fields = [
            ("time_ns", Field.TYPE_SFIXED64, False),
            ("mode", Field.TYPE_STRING, False),
            ("vibration_m_s2", Field.TYPE_FLOAT, True),
        ]
        super().__init__(OUTPUT_BLOCK, schema or message_schema(OUTPUT_BLOCK, fields))

    def encode(self, time_ns: int, mode: str, vibration_m_s2: FloatArray) -> bytes:
        """Encode samples (n,), the first at `time_ns`, as one message."""
        return self.pack(time_ns=time_ns, mode=mode, vibration_m_s2=vibration_m_s2.tolist())

    def decode(self, payload: bytes) -> tuple[str, FloatArray]:
        """Decode one message; return its mode and samples (n,).

        Raises
        ------
        InputError
            The message does not parse.
        """
        with _fitting("the leader's output does not fit its schema"):
            message = self.message.FromString(payload)
            return str(message.mode), np.asarray(message.vibration_m_s2, dtype=np.float64)


@cache
def event_codec() -> Codec:
    """Return the codec of ``mmt.Event``: an event as JSON, and fields that most events have."""
    fields = [("time_s", Field.TYPE_DOUBLE, False)]
    fields += [(name, Field.TYPE_STRING, False) for name in ("event", "kind", "json")]
    return Codec(EVENT, message_schema(EVENT, fields))


def pack_event(event: JsonObject, text: str) -> bytes:
    """Encode an event whose JSON is `text`."""
    kind = event.get("kind")
    return event_codec().pack(
        time_s=event_time_s(event),
        event=str(event.get("event", "")),
        kind="" if kind is None else str(kind),
        json=text,
    )


def event_text(payload: bytes) -> str:
    """Decode the JSON of an event.

    Raises
    ------
    InputError
        The message does not parse.
    """
    with _fitting("an event does not fit its schema"):
        return str(event_codec().message.FromString(payload).json)
