"""What happens in a session, told to the person, the log and the recording."""

import logging
from collections.abc import Callable
from typing import Any, Final

from mmt.core import logs
from mmt.leader.parts import LeaderParts

LOG: Final = logging.getLogger("mmt.leader")


class Journal:
    """Tell and record events, each with its session time.

    Parameters
    ----------
    parts
        The recorder, once there is one.
    say
        Called with a sentence that a person wants to know.
    time_s
        Gives the session time.
    """

    def __init__(
        self, parts: LeaderParts, say: Callable[[str], None], time_s: Callable[[], float]
    ) -> None:
        self.say = say
        self._parts = parts
        self._time_s = time_s
        self._listeners: list[Callable[[float, str], None]] = []

    def listen(self, listener: Callable[[float, str], None]) -> None:
        """Have a function told of every event, by session time and sentence."""
        self._listeners.append(listener)

    @property
    def time_s(self) -> float:
        """Session time as events carry it, to the millisecond."""
        return round(self._time_s(), 3)

    def event(self, sentence: str, **details: object) -> None:
        """Tell and record what a person wants to know."""
        self.say(sentence)
        for listener in self._listeners:
            listener(self.time_s, sentence)
        LOG.info(sentence, extra=logs.details(time_s=self.time_s, **details))
        self.record({"event": sentence, **details})

    def record(self, event: dict[str, Any]) -> None:
        """Record what only a program wants to know."""
        if self._parts.recorder is not None:
            self._parts.recorder.record_event({"time_s": self.time_s, **event})

    def note(self, sentence: str, *, announce: bool, **details: object) -> None:
        """Record what happened, and tell it where it is worth saying."""
        if announce:
            self.event(sentence, **details)
        else:
            self.record({"event": sentence, **details})
