"""What a hostile or broken peer may send, and for how long it is sent."""

import os
import struct
import time

import msgpack
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from mmt.core.frames import CONTACT, ENERGY
from mmt.link import protocol

SECONDS = float(os.environ.get("MMT_FUZZ_SECONDS", "2"))
"""Of each test."""

EVENTS = (
    protocol.FRAMES,
    protocol.END,
    protocol.COMMANDS,
    protocol.WELCOME,
    protocol.STOP,
    protocol.CLOCK,
    protocol.NETWORK,
    protocol.MISSING,
    protocol.BACKFILL,
    protocol.GONE,
    protocol.SETTLE,
    ENERGY,
    CONTACT,
    "connect",
    "disconnect",
    "message",
    "*",
    "",
)

KEYS = ("reason", "frames", "protocol", "clock_id", "session_id", "delay_ms", "profile", "")

_CHUNK = settings(
    max_examples=10, deadline=None, database=None, suppress_health_check=list(HealthCheck)
)


def fuzz(body, *strategies, share=1.0):
    """Run a test on made examples for a share of `SECONDS`; return how many there were.

    The examples are the same in every run; a longer one goes on where a shorter one stops.
    """
    count = 0

    def example(values):
        nonlocal count
        count += 1
        body(*values)

    until_s, chunk = time.monotonic() + share * SECONDS, 0
    while chunk == 0 or time.monotonic() < until_s:
        seed(chunk)(_CHUNK(given(st.tuples(*strategies))(example)))()
        chunk += 1
    return count


def numbers(kind):
    """Numbers of a struct code, the extremes more often than chance would."""
    if kind in "df":
        return st.floats(width=32) | st.sampled_from([0.0, 1e38, -1e38, 1e6, 1.0])
    bits, signed = {"I": (32, False), "q": (64, True)}[kind]
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    near = st.integers(0, 300)
    return near | st.sampled_from([low, high, high - 1, 2**31]) | st.integers(low, high)


def records(layout):
    """One to five packed records, or something that is nearly that."""
    codes = list(layout)
    one = st.tuples(*(numbers(code) for code in codes)).map(
        lambda values: struct.pack(f"<{''.join(codes)}", *values)
    )
    whole = st.lists(one, min_size=1, max_size=5).map(b"".join)
    return whole | whole.map(lambda data: data[:-1]) | whole.map(lambda data: data * 60)


FRAMES = records("Iq" + "f" * 9)
COMMANDS = records("Iqqq" + "f" * 3)
ENERGIES = records("Iqddd")
CONTACTS = FRAMES  # of the same layout

LEAVES = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.sampled_from([0, -1, 1, 2**32 - 1, 2**32, 2**31, 2**63])
    | st.floats()
    | st.text(max_size=20)
    | st.binary(max_size=60)
    | FRAMES
    | COMMANDS
)

ANYTHING = st.recursive(
    LEAVES,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=5), inner, max_size=4)
    ),
    max_leaves=8,
)

ARGUMENTS = st.lists(ANYTHING, max_size=3)


def packet(kind, data, **more):
    """Return a Socket.IO packet as the link's serializer writes it."""
    content = {"type": kind, "data": data, "nsp": "/", **more}
    return msgpack.packb(content)


EVENT_PACKETS = st.builds(
    lambda name, arguments, more: packet(2, [name, *arguments], **more),
    st.sampled_from(EVENTS),
    ARGUMENTS,
    st.sampled_from([{}, {}, {"id": 1}, {"id": "x"}, {"id": -1}, {"nsp": "/other"}, {"nsp": 5}]),
)

PACKETS = EVENT_PACKETS | st.builds(packet, st.integers(-1, 8) | LEAVES, ANYTHING)

BINARY = (
    PACKETS
    | PACKETS.map(lambda data: data[: len(data) // 2])
    | st.binary(max_size=200)
    | st.sampled_from([b"", b"\xc1", b"\xdf\xff\xff\xff\xff", b"\x91" * 5000, bytes(131_073)])
)

TEXT = st.text(max_size=30) | st.sampled_from(
    ["", "0", "1", "2", "2probe", "3", "4", "5", "6", "7", "40", "41", "42[]", "451-", "b4AAAA"]
)

HTTP = st.binary(max_size=200) | st.sampled_from(
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET /health HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer \xff\r\n\r\n",
        b"POST /socket.io/?EIO=4&transport=polling HTTP/1.1\r\nContent-Length: 99\r\n\r\n",
        b"GET /socket.io/?EIO=4&transport=websocket&sid=x HTTP/1.1\r\nHost: a\r\n\r\n",
        b"GET /socket.io/?EIO=4&transport=websocket HTTP/1.1\r\nUpgrade: websocket\r\n\r\n",
        b"PUT /network HTTP/1.1\r\nContent-Length: 9999999999\r\n\r\n{",
        b"GET /" + b"a" * 20_000 + b" HTTP/1.1\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc",
    ]
)
