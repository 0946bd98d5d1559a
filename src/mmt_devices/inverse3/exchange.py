"""What the driver and the process that talks with the service tell each other."""

import struct
from typing import Final, NamedTuple

from mmt.devices.protocols import Vector

COMMAND: Final = struct.Struct("<cq3d")
"""Kind, when it was given (ns, the host's monotonic clock), and three numbers."""
MOVE: Final = b"M"
"""A force (N) of a handle or a place (mm) of a robot, in the device's axes."""
CALIBRATED: Final = b"C"
"""From now on a position without calibration makes no sense."""

FOUND: Final = b"F"
"""The device was chosen; what it says that it is and its identifier, as a text of two lines."""
STATE: Final = b"S"
LOST: Final = b"L"
"""The device gives nothing that can be used any more; why, as a text."""

ABSENT: Final = "answers without the device"
"""One reason for `LOST`."""

_STATE: Final = struct.Struct("<q6d3b")
_NOT_TOLD: Final = -1


class Inverse3State(NamedTuple):
    """One state of the device that makes sense, in its own axes."""

    position_mm: Vector
    velocity_mm_s: Vector
    time_ns: int
    """When it came, by the host's monotonic clock."""


class ServiceAnswer(NamedTuple):
    """The device after an answer of the service."""

    measured: Inverse3State | None
    """The newest that makes sense."""
    calibrated: bool | None
    powered: bool | None
    """As the service says; None where it does not tell."""
    used_elsewhere: bool
    """Whether another program had the device when this one came."""


_NOWHERE: Final = Inverse3State((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), -1)


def pack_state(state: ServiceAnswer) -> bytes:
    """Return the body of a state's message."""
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
    """Return the state of a message's body."""
    time_ns, x, y, z, u, v, w, calibrated, powered, used = _STATE.unpack(body)
    measured = None if time_ns < 0 else Inverse3State((x, y, z), (u, v, w), time_ns)
    return ServiceAnswer(measured, _flag(calibrated), _flag(powered), bool(used))


def _flag(number: int) -> bool | None:
    return None if number == _NOT_TOLD else bool(number)
