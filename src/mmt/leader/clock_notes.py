"""Note in the recording how the follower's clock stands to the leader's."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from mmt.link.clock_exchange import RemoteClock
    from mmt.link.clock_offset import ClockJump

_PERIOD_NS: Final = 10_000_000_000


class ClockNotes:
    """Note the offset when it is first known, every ten seconds, at a jump and at the end.

    Parameters
    ----------
    clock
        The follower's.
    note
        Takes what is to be noted.
    """

    def __init__(self, clock: "RemoteClock", note: Callable[[dict[str, Any]], None]) -> None:
        self._clock = clock
        self._note = note
        self._noted_ns: int | None = None

    def look(self, *, last: bool = False) -> None:
        """Note the offset if it is time; call it several times a second, and at the end."""
        estimate = self._clock.estimate
        if estimate is None:
            return
        since_ns = None if self._noted_ns is None else estimate.time_ns - self._noted_ns
        if since_ns is not None and since_ns < _PERIOD_NS and not (last and since_ns > 0):
            return
        self._noted_ns = estimate.time_ns
        self._note(
            {
                "event": "clocks compared",
                "clock_time_ns": estimate.time_ns,
                "clock_offset_ns": 0 if self._clock.same else estimate.offset_ns,
                "clock_drift_ppm": 0.0 if self._clock.same else round(estimate.drift * 1e6, 3),
                "clock_uncertainty_ns": 0 if self._clock.same else estimate.uncertainty_ns,
                "same_clock": self._clock.same,
            }
        )

    def jumped(self, jump: "ClockJump") -> tuple[str, dict[str, Any]]:
        """Return the sentence and the details of a jump; the offset is noted anew after it."""
        self._noted_ns = None
        details = {"clock_time_ns": jump.time_ns, "clock_step_ns": jump.step_ns}
        return f"clocks: the follower's {jump.describe()}", details
