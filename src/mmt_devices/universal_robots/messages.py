"""Messages between a driver and the process that talks to the arm, over two pipes."""

import struct
from typing import Final, NamedTuple

from mmt.core.quaternions import Vector

COMMAND: Final = struct.Struct("<3d")
"""Move to a position in the base's frame (m)."""

_STATE: Final = struct.Struct("<7dq3d?")


class UrState(NamedTuple):
    """State of the arm in one cycle of its controller.

    An arm that is to move takes commands before its first state comes.
    """

    timestamp_s: float
    """Time since the controller was started."""
    position_m: Vector
    """Of the tool's centre point, in the base's frame."""
    force_n: Vector
    """At the tool's centre point, in the base's axes."""
    time_ns: int
    """Time of arrival, by the host's monotonic clock."""
    rotation_rad: Vector
    """Rotation vector of the tool, in the base's frame."""
    program_runs: bool
    """Whether a program runs on the controller; an e-Series arm zeroes its sensor at its start."""


def pack_state(state: UrState) -> bytes:
    """Return the body of a `STATE` message."""
    (timestamp_s, position_m, force_n, time_ns, rotation_rad, runs) = state
    return _STATE.pack(timestamp_s, *position_m, *force_n, time_ns, *rotation_rad, runs)


def unpack_state(body: bytes) -> UrState:
    """Return the state in the body of a `STATE` message."""
    timestamp_s, x, y, z, u, v, w, time_ns, a, b, c, runs = _STATE.unpack(body)
    return UrState(timestamp_s, (x, y, z), (u, v, w), time_ns, (a, b, c), runs)
