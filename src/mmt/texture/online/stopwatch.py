"""Seconds spent on each stage of something."""

import time


class Stopwatch:
    """Laps by name in ``laps``; `resume` after a pause that is not to count."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self.resume()

    def resume(self) -> None:
        """Begin to count here."""
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Note the seconds since the last lap or resumption."""
        now = time.perf_counter()
        self.laps[name] = now - self._last
        self._last = now
