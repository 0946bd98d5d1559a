"""Read the messages of ROS bags, and of MCAP files with CDR, JSON or Protobuf.

Each topic is decoded by its definition in the file; messages that cannot be decoded are left out.
"""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from mmt.core.errors import InputError, short_message
from mmt.session.mcap.messages import message_class
from mmt_bridges.ros.storage import StoredMessage, stored_messages

_LARGE_BYTES: Final = 1 << 16
"""Of larger messages (pictures, point clouds) only the first is decoded, for the names."""
_LONGEST_BYTES: Final = 1 << 26
"""Size to which a compressed message may unpack."""
_ZSTD: Final = b"\x28\xb5\x2f\xfd"
"""Begins a message that its recorder has compressed; CDR begins with zero."""

Decode = Callable[[bytes], Any]


def decoded_messages(path: Path, notes: list[str]) -> Iterator[tuple[StoredMessage, Any]]:
    """Yield the messages of a bag or an MCAP file; add a note for each topic with lost messages.

    Each comes as it is stored and decoded: numbers, texts, lists, dictionaries and dataclasses.
    """
    decoders: dict[tuple[int | str, str, str, bytes], Decode] = {}
    lost: dict[str, list[Any]] = {}
    for raw in stored_messages(path, notes):
        key = raw.source, raw.topic, raw.kind, raw.definition
        if len(raw.data) > _LARGE_BYTES and decoders.get(key, _undecoded) is not _undecoded:
            continue
        try:
            if key not in decoders:
                decoders[key] = _undecoded  # unless there is a decoder
                decoders[key] = _decoder(raw)
            message = decoders[key](_unpacked(raw))
        except Exception as error:  # noqa: BLE001 - damage reaches every part of the libraries
            why = f"type {raw.kind or 'unknown'}, {raw.encoding}: {short_message(error)}"
            lost.setdefault(raw.topic, [0, why])[0] += 1
            continue
        yield raw, message
    notes += [
        f"{count} messages of {topic} cannot be read and were left out ({why})"
        for topic, (count, why) in lost.items()
    ]


def _undecoded(_: bytes) -> Any:
    raise InputError("its messages have no decoder")


def _decoder(raw: StoredMessage) -> Decode:
    """Return the decoder of a topic's messages, by the definition in the file."""
    if raw.encoding == "json":
        return json.loads
    if raw.encoding == "protobuf":
        made = message_class(raw.definition, raw.kind)
        return lambda data: _plain(made.FromString(data))
    if raw.encoding not in {"cdr", "ros1"}:
        raise InputError("messages of this encoding are not known")
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    definition, kind = raw.definition.decode(), raw.kind.replace("::", "/")
    if raw.encoding == "ros1" and "/msg/" not in kind:
        kind = kind.replace("/", "/msg/")
    idl = raw.definition_encoding in {"ros2idl", "omgidl"}
    if not definition.strip():
        store = get_typestore(Stores.LATEST)
        if kind not in store.types:
            raise InputError("the file does not define it, and it is no standard one")
    else:
        store = get_typestore(Stores.EMPTY)
        parts = [part.partition("\n")[2] for part in definition.split(f"{'=' * 80}\nIDL: ")[1:]]
        for part in parts or ([definition] if idl else []):
            store.register(get_types_from_idl(part))
        if not parts and not idl:
            store.register(get_types_from_msg(definition, kind))
    if raw.encoding == "ros1":
        return lambda data: store.deserialize_ros1(data, kind)
    return lambda data: store.deserialize_cdr(data, kind)


def _unpacked(raw: StoredMessage) -> bytes:
    """Return a message's data, decompressed if the recorder has compressed each message."""
    if raw.encoding != "cdr" or not raw.data.startswith(_ZSTD):
        return raw.data
    import zstandard

    if zstandard.frame_content_size(raw.data) > _LONGEST_BYTES:
        raise InputError("a message unpacks to more than it may")
    unpacked: bytes = zstandard.decompress(raw.data, _LONGEST_BYTES)
    return unpacked


def _plain(message: Any) -> Any:
    """Return a Protobuf message as dictionaries and lists, without fields that were not given."""
    if not hasattr(message, "DESCRIPTOR"):
        return message
    plain = {}
    for field in message.DESCRIPTOR.fields:
        if field.has_presence and not field.has_default_value and not message.HasField(field.name):
            continue  # its value would be zero, which nobody measured
        value = getattr(message, field.name)
        repeated = hasattr(value, "append") or hasattr(value, "add")
        plain[field.name] = [_plain(each) for each in value] if repeated else _plain(value)
    return plain
