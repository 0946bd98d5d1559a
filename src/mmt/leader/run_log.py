"""Events of a run, and its state for the parts and the summary."""

import logging
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from mmt.core.output import logs
from mmt.core.running.process import ProcessMeter
from mmt.core.running.ticking import TimeHistogram

if TYPE_CHECKING:
    from mmt.leader.surface_log import SurfaceLog
    from mmt.texture.online.updates import ModelUpdate

LOG: Final = logging.getLogger("mmt.leader")


class Journal:
    """Record events, each with its session time, and tell the user of some.

    Parameters
    ----------
    tell
        Called with every event, and with its sentence if the user is told.
    say
        Called with a sentence for the user.
    time_s
        Returns the session time.
    """

    def __init__(
        self,
        tell: Callable[[dict[str, Any], str | None], None],
        say: Callable[[str], None],
        time_s: Callable[[], float],
    ) -> None:
        self.say = say
        self._tell_parts = tell
        self._time_s = time_s

    @property
    def time_s(self) -> float:
        """Session time as events carry it, to the millisecond."""
        return round(self._time_s(), 3)

    def event(self, sentence: str, **details: object) -> None:
        """Record an event and tell the user."""
        self.say(sentence)
        LOG.info(sentence, extra=logs.details_for_log(time_s=self.time_s, **details))
        self._tell({"event": sentence, **details}, sentence)

    def record(self, event: dict[str, Any]) -> None:
        """Record an event without telling the user."""
        self._tell(event, None)

    def note(self, sentence: str, *, announce: bool, **details: object) -> None:
        """Record an event, and tell the user if `announce`."""
        if announce:
            self.event(sentence, **details)
        else:
            self.record({"event": sentence, **details})

    def _tell(self, event: dict[str, Any], sentence: str | None) -> None:
        self._tell_parts({"time_s": self.time_s, **event}, sentence)


@dataclass
class RunLog:
    """State and figures collected while the leader runs."""

    session_id: str = field(default_factory=lambda: uuid.uuid4().hex[:12])
    meter: ProcessMeter = field(default_factory=ProcessMeter)
    update: "ModelUpdate | None" = None
    update_times: TimeHistogram = field(default_factory=TimeHistogram)
    switches: list[dict[str, Any]] = field(default_factory=list)
    late_while_modelling: TimeHistogram = field(default_factory=TimeHistogram)
    late_otherwise: TimeHistogram = field(default_factory=TimeHistogram)
    start_s: float | None = None
    stop_s: float | None = None
    ready_s: float | None = None
    surfaces: "SurfaceLog | None" = None
    """Which surface the tool was on, or None if surfaces are not told apart."""
