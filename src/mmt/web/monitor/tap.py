"""Buffer from the tick and the link to the monitor: stores references, copies nothing."""

from collections import deque
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.devices.protocols import InterfaceState

_MOST_BLOCKS: Final = 500
"""Half a second at one frame per message; the monitor empties the buffer more often."""


class MonitorTap:
    """Holds the data since the monitor's last reading.

    The 1 kHz path calls the `add` methods; without viewers they return at once.
    """

    def __init__(self) -> None:
        self.watched = False
        """Whether there are viewers."""
        self.state: InterfaceState | None = None
        """State of the hand at the last tick, or None if the hand is not read."""
        self._frames: deque[RecordArray] = deque(maxlen=_MOST_BLOCKS)
        self._played: deque[FloatArray] = deque(maxlen=_MOST_BLOCKS)

    def add_frames(self, frames: RecordArray) -> None:
        """Store frames (n,) that have just arrived."""
        if self.watched:
            self._frames.append(frames)

    def add_output(self, vibration_m_s2: FloatArray) -> None:
        """Store samples (n,) that were written to the actuator."""
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
