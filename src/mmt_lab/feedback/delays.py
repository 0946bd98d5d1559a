"""Lines that deliver late: a fixed delay, with or without jitter, in order."""

from collections import deque
from typing import Generic, TypeVar

import numpy as np

Item = TypeVar("Item")


class DelayLine(Generic[Item]):
    """Deliver items in their order, each late by its own delay.

    As on a link over TCP, an item that comes after a later one waits for nothing, and one
    before which another is still on its way waits for it.

    Parameters
    ----------
    delay_ticks
        Mean delay.
    jitter_ticks
        Delays are spread evenly over this much to either side; at most the delay.
    seed
        Of the jitter.
    """

    def __init__(self, delay_ticks: int, jitter_ticks: int, seed: int) -> None:
        self._delay = delay_ticks
        self._jitter = min(jitter_ticks, delay_ticks)
        self._rng = np.random.default_rng(seed)
        self._waiting: deque[tuple[int, Item]] = deque()
        self._latest = 0

    def push(self, tick: int, item: Item) -> None:
        """Send an item at a tick."""
        off = int(self._rng.integers(-self._jitter, self._jitter + 1)) if self._jitter else 0
        self._latest = max(self._latest, tick + self._delay + off)
        self._waiting.append((self._latest, item))

    def pop(self, tick: int) -> list[Item]:
        """Return what has arrived up to a tick."""
        arrived = []
        while self._waiting and self._waiting[0][0] <= tick:
            arrived.append(self._waiting.popleft()[1])
        return arrived
