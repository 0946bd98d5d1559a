"""Tell the person that a sensor is driven beyond its range; how often is counted elsewhere."""

import logging
import time
from typing import Final

LOG: Final = logging.getLogger("mmt.devices")

_QUIET_S: Final = 10.0
"""An overload that goes on, or comes back soon, is told so often."""


class OverloadNotice:
    """Warn at the first overload, and no more than every ten seconds from then on."""

    def __init__(self) -> None:
        self._quiet_until_s = 0.0

    def tell(self, sentence: str) -> None:
        """Say that it is overloaded, where that was not said lately."""
        now_s = time.monotonic()
        if now_s >= self._quiet_until_s:
            self._quiet_until_s = now_s + _QUIET_S
            LOG.warning("%s", sentence)
