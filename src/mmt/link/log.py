"""Logging of what a peer does wrong, at a rate that a bad peer cannot drive up."""

import logging
import time
from collections.abc import Hashable
from typing import Final

LOG: Final = logging.getLogger("mmt.link")

PERIOD_S: Final = 1.0
"""One line of each kind per this time."""

_MOST_KINDS: Final = 64


class RateLimit:
    """Allow one event of each kind a second, and say how many were held back."""

    def __init__(self) -> None:
        self._next_s: dict[Hashable, float] = {}
        self._held: dict[Hashable, int] = {}

    def allow(self, kind: Hashable) -> int:
        """Return 0 to hold an event back, else 1 plus those held back since the last."""
        now_s = time.monotonic()
        if now_s < self._next_s.get(kind, 0.0):
            self._held[kind] = self._held.get(kind, 0) + 1
            return 0
        if len(self._next_s) >= _MOST_KINDS:
            self._next_s.clear()
            self._held.clear()
        self._next_s[kind] = now_s + PERIOD_S
        return 1 + self._held.pop(kind, 0)


class _RateFilter(logging.Filter):
    """Hold back what repeats: the library logs a traceback for each malformed packet."""

    def __init__(self) -> None:
        super().__init__()
        self._limit = RateLimit()

    def filter(self, record: logging.LogRecord) -> bool:
        return self._limit.allow(record.msg) > 0


def wire_logger() -> logging.Logger:
    """Return the logger handed to python-socketio: errors alone, one of a kind a second."""
    logger = logging.getLogger("mmt.link.wire")
    if not logger.filters:
        logger.addFilter(_RateFilter())
        logger.setLevel(logging.ERROR)
    return logger
