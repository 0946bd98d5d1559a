"""What the tick and the link leave for the monitor: references, no copies, no arithmetic."""

from collections import deque
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.devices.protocols import InterfaceState

_MOST_BLOCKS: Final = 500
"""Half a second at one frame a message; the monitor looks more often than that."""


class MonitorTap:
    """Keep what has come since the monitor looked last.

    The 1 kHz path calls the first two methods; without viewers they return at once.
    """

    def __init__(self) -> None:
        self.watched = False
        """Whether there are viewers."""
        self.state: InterfaceState | None = None
        """The hand's state as of the last tick, None where it was not read."""
        self._frames: deque[RecordArray] = deque(maxlen=_MOST_BLOCKS)
        self._played: deque[FloatArray] = deque(maxlen=_MOST_BLOCKS)

    def add_frames(self, frames: RecordArray) -> None:
        """Keep frames (n,) that have just come."""
        if self.watched:
            self._frames.append(frames)

    def add_output(self, vibration_m_s2: FloatArray) -> None:
        """Keep samples (n,) that were written to the actuator."""
        if self.watched:
            self._played.append(vibration_m_s2)

    def frames(self) -> list[RecordArray]:
        """Return the blocks of frames since the last call."""
        blocks = list(self._frames)
        self._frames.clear()
        return blocks

    def played(self) -> FloatArray:
        """Return the samples (n,) played since the last call."""
        blocks = list(self._played)
        self._played.clear()
        return np.concatenate(blocks) if blocks else np.zeros(0)
