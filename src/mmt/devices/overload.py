"""Warn that a sensor is driven beyond its range; the sensor itself counts how often."""

import logging
import time
from typing import Final

LOG: Final = logging.getLogger("mmt.devices")

_QUIET_S: Final = 10.0
"""Time between two warnings while an overload goes on or comes back."""


class OverloadNotice:
    """Warn at the first overload, and then at most every ten seconds."""

    def __init__(self) -> None:
        self._quiet_until_s = 0.0

    def warn(self, sentence: str) -> None:
        """Warn with this sentence, unless a warning was given lately."""
        now_s = time.monotonic()
        if now_s >= self._quiet_until_s:
            self._quiet_until_s = now_s + _QUIET_S
            LOG.warning("%s", sentence)
