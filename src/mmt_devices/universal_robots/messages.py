"""What a driver and the process that talks to the arm tell each other, by two pipes."""

import struct
from typing import Final, NamedTuple

from mmt_devices.universal_robots.frame import Vector

COMMAND: Final = struct.Struct("<c3d")
MOVE: Final = b"M"
"""To a place in the base's frame (m)."""
RELEASE: Final = b"R"
"""Give up the control."""

STATE: Final = b"S"
CONTROLLED: Final = b"C"
"""The arm takes commands from now on."""
LOST: Final = b"L"
"""It takes none any more; why, as a text."""
_STATE: Final = struct.Struct("<7dq")


class UrState(NamedTuple):
    """The arm at a cycle of its controller."""

    timestamp_s: float
    """Since the controller was started."""
    position_m: Vector
    """Of the tool's centre point, in the base's frame."""
    force_n: Vector
    """At the tool's centre point, in the base's axes."""
    time_ns: int
    """When it came, by the host's monotonic clock."""


def pack_state(state: UrState) -> bytes:
    """Return the body of a state's message."""
    return _STATE.pack(state.timestamp_s, *state.position_m, *state.force_n, state.time_ns)


def unpack_state(body: bytes) -> UrState:
    """Return the state of a message's body."""
    timestamp_s, x, y, z, u, v, w, time_ns = _STATE.unpack(body)
    return UrState(timestamp_s, (x, y, z), (u, v, w), time_ns)
