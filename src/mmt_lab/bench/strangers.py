"""A stranger: a client without the token that keeps a leader's port as busy as it can.

`disturb` runs in a process of its own: it connects, sends the traffic of its kind in `KINDS`, and
connects anew when the leader closes the connection. A `BYSTANDER` connects nowhere, but is as busy,
for comparison: services and strangers of a bench share processors, and most of a stranger's
processor time is that of its start.
"""

import functools
import itertools
import socket
import struct
import time
from collections.abc import Iterable
from multiprocessing.connection import Connection
from typing import Final
from urllib.parse import urlsplit

import msgpack

from mmt.link.protocol import CONNECT_PACKET, EVENT_NAMESPACE
from mmt.link.websocket import LINK_PATH
from mmt_lab.harness.processes import be_apart

_PATIENCE_S: Final = 1.0
"""How long a leader may take nothing before the stranger connects anew."""
_CONTINUATION, _TEXT, _BINARY, _PING, _PONG = 0, 1, 2, 9, 10
"""WebSocket opcodes."""
_UNMASKED: Final = bytes(4)
"""Mask of a frame, which a client must send; this one changes nothing."""
_UPGRADE: Final = (
    f"GET {LINK_PATH}?EIO=4&transport=websocket HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: MTIzNDU2Nzg5MDEyMzQ1Ng==\r\n\r\n"
).encode()


def _frame(opcode: int, payload: bytes) -> bytes:
    """Return a WebSocket frame."""
    length = len(payload)
    if length < 126:
        head = bytes((0x80 | opcode, 0x80 | length))
    elif length < 2**16:
        head = struct.pack(">BBH", 0x80 | opcode, 0x80 | 126, length)
    else:
        head = struct.pack(">BBQ", 0x80 | opcode, 0x80 | 127, length)
    return head + _UNMASKED + payload


def _piece(opcode: int) -> bytes:
    """Return an empty WebSocket frame that is not the last one of its message."""
    return bytes((opcode, 0x80)) + _UNMASKED


def _hello(auth: object) -> bytes:
    """Return the WebSocket frame of a Socket.IO connection with this ``auth``."""
    packet = {"type": CONNECT_PACKET, "data": auth, "nsp": EVENT_NAMESPACE}
    return _frame(_BINARY, msgpack.packb(packet))


KINDS: Final = {
    "maps": "messages of 130,000 empty maps",
    "hellos": "hellos of 60,000 empty maps",
    "tokens": "hellos with a wrong token, a connection each",
    "texts": "messages of one byte",
    "pings": "pings of the WebSocket",
    "pongs": "pongs of the WebSocket",
    "pieces": "a message in empty pieces",
    "requests": "requests of a page, in a row",
}
"""Kinds of strangers, and the traffic that each sends."""


BYSTANDER: Final = "bystander"
"""Kind of a process that is as busy as a stranger, also at its start, but connects nowhere."""
_TURN_S, _BUSY_S = 0.4, 0.002
"""Period of a stranger's turns during a session, and processor time used in a turn."""


def _chunks(kind: str) -> Iterable[bytes]:
    """Return the chunks that a stranger of one of `KINDS` sends on a connection."""
    if kind == "tokens":
        return (_UPGRADE, _hello({"token": "wrong"}))
    first, repeated = _flood(kind)
    return itertools.chain((first,), itertools.repeat(repeated))


@functools.cache
def _flood(kind: str) -> tuple[bytes, bytes]:
    """Return the first chunk of a kind other than ``tokens``, and the chunk repeated after it."""
    return {
        "maps": (_UPGRADE, _frame(_BINARY, msgpack.packb([{}] * 130_000))),
        "hellos": (_UPGRADE, _hello({"token": "wrong", "maps": [{}] * 60_000})),
        "texts": (_UPGRADE, _frame(_TEXT, b"3") * 1000),
        "pings": (_UPGRADE, _frame(_PING, b"") * 1000),
        "pongs": (_UPGRADE, _frame(_PONG, b"") * 1000),
        "pieces": (_UPGRADE + _piece(_TEXT), _piece(_CONTINUATION) * 1000),
        "requests": (b"", b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 1000),
    }[kind]


def send_as_stranger(host: str, port: int, kind: str) -> int:
    """Open one connection and send all that the leader accepts; return the number of bytes."""
    sent = 0
    try:
        with socket.create_connection((host, port), _PATIENCE_S) as connection:
            for chunk in _chunks(kind):
                connection.sendall(chunk)
                sent += len(chunk)
            connection.shutdown(socket.SHUT_WR)
            while connection.recv(65_536):
                pass
    except OSError:
        pass  # the leader closed the connection or reads no more
    return sent


def disturb(pipe: Connection, url: str, kind: str) -> None:
    """Be a stranger until the pipe is closed, at low priority, as if on another machine."""
    be_apart()
    address = urlsplit(url)
    while not pipe.poll(_TURN_S if kind == BYSTANDER else 0.0):
        if kind == BYSTANDER:
            busy_until_s = time.thread_time() + _BUSY_S
            while time.thread_time() < busy_until_s:
                pass
        else:
            send_as_stranger(address.hostname or "", address.port or 80, kind)
