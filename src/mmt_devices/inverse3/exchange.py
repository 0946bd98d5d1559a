"""Messages between the driver and the process that talks to the service."""

import struct
from typing import Final, NamedTuple

from mmt.core.arrays import Vector

COMMAND: Final = struct.Struct("<cq3d")
"""Kind, time of the command (ns, host's monotonic clock), and three numbers."""
MOVE: Final = b"M"
"""Force (N) for a handle, or position (mm) for a robot, in the device's axes."""
CALIBRATED: Final = b"C"
"""From now on, positions are implausible if the device is not calibrated."""

FOUND: Final = b"F"
"""The device was chosen; a text with two lines, its type and its identifier."""

ABSENT: Final = "answers without the device"
"""One reason for a message `LOST`."""

_STATE: Final = struct.Struct("<q6d3b")
_NOT_TOLD: Final = -1


class Inverse3State(NamedTuple):
    """One plausible state of the device, in the device's axes."""

    position_mm: Vector
    velocity_mm_s: Vector
    time_ns: int
    """Time of arrival, by the host's monotonic clock."""


class ServiceAnswer(NamedTuple):
    """State of the device after an answer of the service."""

    measured: Inverse3State | None
    """Newest plausible state, or None before the first."""
    calibrated: bool | None
    powered: bool | None
    """This and `calibrated` as the service reports them, or None if it does not."""
    used_elsewhere: bool
    """Whether another program had the device when this one connected."""


_NOWHERE: Final = Inverse3State((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), -1)


def pack_state(state: ServiceAnswer) -> bytes:
    """Return the body of a `STATE` message."""
    position_mm, velocity_mm_s, time_ns = state.measured or _NOWHERE
    return _STATE.pack(
        time_ns,
        *position_mm,
        *velocity_mm_s,
        _NOT_TOLD if state.calibrated is None else state.calibrated,
        _NOT_TOLD if state.powered is None else state.powered,
        state.used_elsewhere,
    )


def unpack_state(body: bytes) -> ServiceAnswer:
    """Return the state in the body of a `STATE` message."""
    time_ns, x, y, z, u, v, w, calibrated, powered, used = _STATE.unpack(body)
    measured = None if time_ns < 0 else Inverse3State((x, y, z), (u, v, w), time_ns)
    return ServiceAnswer(measured, _flag(calibrated), _flag(powered), bool(used))


def _flag(number: int) -> bool | None:
    return None if number == _NOT_TOLD else bool(number)
