"""A driver that is late by a known number of ticks, for the measure that is to find that."""

from collections import deque

from mmt.devices.protocols import Vector
from mmt.testing.emulated.robot import DatagramRobot

READS, WRITES = 7, 12


class DelayedRobot(DatagramRobot):
    """The virtual robot, its positions `READS` and its commands `WRITES` ticks old."""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self._places: deque[Vector] = deque(maxlen=READS + 1)
        self._commands: deque[Vector] = deque(maxlen=WRITES + 1)

    def read(self) -> Vector:
        self._places.append(super().read())
        return self._places[0]

    def write(self, position_mm: Vector) -> None:
        self._commands.append(position_mm)
        super().write(self._commands[0])
