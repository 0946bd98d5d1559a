"""The hand's motion as commands for the follower."""

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.frames import COMMAND_DTYPE
from mmt.devices.protocols import Vector
from mmt.leader.numbering import SessionNumbering


class MotionCommands:
    """Make one motion command a tick, numbered, with the echo of the newest frame's time.

    Parameters
    ----------
    numbering
        Knows the newest frame.
    """

    def __init__(self, numbering: SessionNumbering) -> None:
        self._numbering = numbering
        self._sequence = 0

    def make(self, now_ns: int, position_mm: Vector) -> RecordArray:
        """Return the command, shape (1,), that asks the follower to take a position."""
        echo_time_ns = self._numbering.follower_time_ns
        command = np.zeros(1, dtype=COMMAND_DTYPE)
        command[0] = (
            self._sequence,
            now_ns,
            echo_time_ns,
            now_ns - self._numbering.arrival_ns if echo_time_ns else 0,
            position_mm,
        )
        self._sequence += 1
        return command
