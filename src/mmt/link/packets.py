"""Socket.IO packets: decoded once, and those of strangers within narrow bounds."""

from collections.abc import Mapping
from typing import Any, Final

import msgpack
from socketio.msgpack_packet import MsgPackPacket

from mmt.link.protocol import EVENT_NAMESPACE, MSGPACK_EVENT

_RESERVED: Final = {"connect", "connect_error", "disconnect"}
_MOST_OF_STRANGER: Final = 32
"""Maps and arrays that a message may have before admission, and items that each may have."""


class Packet(MsgPackPacket):  # type: ignore[misc]  # the library has no types
    """The library's Socket.IO packet, which does not decode a `DecodedPacket` again."""

    def decode(self, encoded_packet: bytes) -> None:
        """Set this packet's fields from a message; see the library."""
        packet = (
            encoded_packet.packet
            if isinstance(encoded_packet, DecodedPacket)
            else decode_packet(encoded_packet)
        )
        if packet is None:
            raise ValueError("malformed packet")
        self.packet_type, self.namespace = packet["type"], packet["nsp"]
        self.data, self.id = packet.get("data"), packet.get("id")


class DecodedPacket(bytes):
    """A message with its decoded packet."""

    packet: dict[str, Any]


def decode_packet(message: bytes, *, stranger: bool = False) -> dict[str, Any] | None:
    """Decode a Socket.IO packet, which is not trusted; None if it is malformed.

    A stranger's packet may have no more maps, arrays and items than a hello needs. This is checked
    during decoding, because 100 kB of empty maps would take milliseconds.
    """
    limits: dict[str, Any] = {"ext_hook": _octets}
    if stranger:
        left = iter(range(_MOST_OF_STRANGER))

        def count(container: Any) -> Any:
            if next(left, None) is None:
                raise ValueError("too many maps and arrays")
            return container

        limits |= dict.fromkeys(("max_map_len", "max_array_len"), _MOST_OF_STRANGER)
        limits |= {"object_hook": count, "list_hook": count}
    try:
        packet = msgpack.unpackb(message, **limits)
    except (ValueError, TypeError, OverflowError, RecursionError):
        return None
    return packet if isinstance(packet, dict) and {"type", "nsp"} <= packet.keys() else None


def _octets(code: int, data: bytes) -> object:
    """Return bytes for extension 0, as which JavaScript's parser sends an ``ArrayBuffer``."""
    return data if code == 0 else msgpack.ExtType(code, data)


def binary_event(packet: Mapping[str, Any]) -> tuple[str, bytes] | None:
    """Return name and argument of an event that may bypass the library, else None.

    Such an event has the link's namespace and one binary argument, and asks for no acknowledgement.
    """
    if packet["nsp"] != EVENT_NAMESPACE or packet.get("id") is not None:
        return None
    match packet:
        case {"type": int(kind), "data": [str(name), bytes(argument)]}:
            return (name, argument) if kind == MSGPACK_EVENT else None
    return None


def is_reserved(packet: Mapping[str, Any]) -> bool:
    """Return whether this is an event with the name of one of the library's own handlers."""
    match packet:
        case {"type": int(kind), "data": [str(name), *_]}:
            return kind == MSGPACK_EVENT and name in _RESERVED
    return False
