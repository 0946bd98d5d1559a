"""State of an arm, which the process that talks to the arm sends its driver."""

from typing import NamedTuple

from mmt.core.quaternions import Vector


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
