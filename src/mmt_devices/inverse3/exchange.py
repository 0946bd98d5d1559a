"""Messages between the driver and the process that talks to the service."""

from typing import Final, NamedTuple

from mmt.core.arrays import Vector

MOVE: Final = "move"
"""Command: time (ns, host's monotonic clock), and force (N) for a handle or position (mm) for a
robot, in the device's axes."""
CALIBRATED: Final = "calibrated"
"""Command: from now on, positions are implausible if the device is not calibrated."""

FOUND: Final = "found"
"""Message: the device was chosen; the body is its type and its identifier."""

ABSENT: Final = "answers without the device"
"""One reason for a message `LOST`."""


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
