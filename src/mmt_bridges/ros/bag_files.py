"""Read the messages of ROS bags, and of MCAP files with CDR, JSON or Protobuf.

Each topic is decoded by its definition in the file; messages that cannot be decoded are left out.
MCAP files are read as far as they are whole, with their index or without.
"""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

from mmt.core.errors import InputError, short_message
from mmt.session.mcap_scan import iterate_mcap
from mmt.session.mcap_writer import FRAMES_TOPIC
from mmt.session.messages import message_class

_LARGE_BYTES: Final = 1 << 16
"""Of larger messages (pictures, point clouds) only the first is decoded, for the names."""

Decode = Callable[[bytes], Any]


class StoredMessage(NamedTuple):
    """A message as it stands in a file."""

    topic: str
    source: int
    """Number of the publisher on its topic, as far as the file tells publishers apart."""
    kind: str
    """Name of the message's type."""
    encoding: str
    definition: bytes
    received_ns: int
    data: bytes

    @property
    def in_si_units(self) -> bool:
        """Whether the type is one of those whose positions are in metres."""
        return self.encoding in {"cdr", "ros1"} or self.kind.startswith("foxglove.")


def decoded_messages(path: Path, notes: list[str]) -> Iterator[tuple[StoredMessage, Any]]:
    """Yield the messages of a bag or an MCAP file; add a note for each topic with lost messages.

    Each comes as it is stored and decoded: numbers, texts, lists, dictionaries and dataclasses.
    """
    decoders: dict[tuple[int, str, str, bytes], Decode | None] = {}
    lost: dict[str, list[Any]] = {}
    for raw in _raw_messages(path, notes):
        key = raw.source, raw.topic, raw.kind, raw.definition
        known = key in decoders
        if known and (decoders[key] is None or len(raw.data) > _LARGE_BYTES):
            if decoders[key] is None:
                lost[raw.topic][0] += 1
            continue
        try:
            if not known:
                decoders[key] = None
                decoders[key] = _decoder(raw)
            decode = decoders[key]
            message = decode(raw.data) if decode is not None else None
        except Exception as error:  # noqa: BLE001 - damage reaches every part of the libraries
            why = f"type {raw.kind or 'unknown'}, {raw.encoding}: {short_message(error)}"
            lost.setdefault(raw.topic, [0, why])[0] += 1
            continue
        yield raw, message
    notes += [
        f"{count} messages of {topic} cannot be read and were left out ({why})"
        for topic, (count, why) in lost.items()
    ]


def _raw_messages(path: Path, notes: list[str]) -> Iterator[StoredMessage]:
    inside = sorted(path.glob("[!.]*")) if path.is_dir() else [path]
    stored = [file for file in inside if file.suffix.lower() == ".mcap"]
    described = any(file.name == "metadata.yaml" for file in inside)
    others = [file for file in inside if file.suffix.lower() in {".db3", ".bag", ".zstd"}]
    if path.is_dir() and not stored and not others:
        raise InputError("this is not a ROS bag: there is no .mcap or .db3 file in this folder")
    if stored and not others:
        for file in stored:
            yield from _of_mcap(file, notes)
        return
    if path.is_dir() and not described:
        notes.append("the folder has no metadata.yaml: its files were read one after the other")
    for each in [path] if described or path.is_file() else others:
        yield from _of_bag(each)


def _of_mcap(path: Path, notes: list[str]) -> Iterator[StoredMessage]:
    problems: list[str] = []
    publishers: dict[str, dict[int, int]] = {}
    for schema, channel, message in iterate_mcap(path, problems):
        if channel.topic == FRAMES_TOPIC and schema is not None and "mmt" in schema.name:
            raise InputError("a session of mmt is one as it is, without import")
        definition = schema.data if schema is not None else b""
        kind = schema.name if schema is not None else ""
        of_topic = publishers.setdefault(channel.topic, {})
        source = of_topic.setdefault(channel.id, len(of_topic))
        yield StoredMessage(
            *(channel.topic, source, kind, channel.message_encoding),
            *(definition, message.log_time, message.data),
        )
    if problems:
        notes.append(f"{path.name}: {', '.join(problems)}; what is whole was read")


def _of_bag(path: Path) -> Iterator[StoredMessage]:
    from rosbags import rosbag1, rosbag2

    of_ros1 = path.suffix.lower() == ".bag"
    with (rosbag1.Reader if of_ros1 else rosbag2.Reader)(path) as reader:
        definitions = {each.id: each.msgdef.data.encode() for each in reader.connections}
        for connection, received_ns, data in reader.messages():
            yield StoredMessage(
                *(connection.topic, connection.id, connection.msgtype),
                "ros1" if of_ros1 else "cdr",
                definitions[connection.id],
                *(received_ns, bytes(data)),
            )


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

    definition, kind = raw.definition.decode(), raw.kind
    if not definition.strip():
        store = get_typestore(Stores.LATEST)
        if kind not in store.types:
            raise InputError("the file does not define it, and it is no standard one")
    else:
        store = get_typestore(Stores.EMPTY)
        parts = definition.split(f"{'=' * 80}\nIDL: ")[1:]
        for part in parts:
            store.register(get_types_from_idl(part.partition("\n")[2]))
        if not parts:
            store.register(get_types_from_msg(definition, kind))
    if raw.encoding == "ros1":
        return lambda data: store.deserialize_ros1(data, kind)
    return lambda data: store.deserialize_cdr(data, kind)


def _plain(message: Any) -> Any:
    """Return a Protobuf message as dictionaries and lists."""
    if not hasattr(message, "DESCRIPTOR"):
        return message
    plain = {}
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        repeated = hasattr(value, "append") or hasattr(value, "add")
        plain[field.name] = [_plain(each) for each in value] if repeated else _plain(value)
    return plain
