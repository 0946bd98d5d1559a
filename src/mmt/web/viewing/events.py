"""Events and link statistics of a recording, for the page."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.session.data import JsonObject, clock_offset_ns, compares_clocks
from mmt.web.monitor.states import LATENCY_MS

Kind = Literal["mark", "gap", "criterion", "other"]
_SURFACE_CHANGES: Final = ("new", "recalled", "identified")
_MOST: Final = 2000
"""Most events that a page receives."""


@dataclass(frozen=True)
class SessionEvent:
    """An event as the page lists it."""

    at_s: float
    kind: Kind
    sentence: str


def session_events(events: Sequence[JsonObject]) -> list[SessionEvent]:
    """Return the events to list, in order.

    Comparisons of clocks and filled gaps are left out; beyond 2000 events, all gaps as well.
    """
    found = [h for event in events if (h := _session_event(event)) is not None]
    if len(found) > _MOST:
        found = [h for h in found if h.kind != "gap"]
    return found[:_MOST]


def switch_s(events: Sequence[JsonObject]) -> float | None:
    """Return when the model first drove the vibration, or None if there is no such event."""
    return next((e["at_s"] for e in events if e.get("event") == "vibration synthesized"), None)


def _session_event(event: JsonObject) -> SessionEvent | None:
    sentence, at_s = str(event.get("event", "")), max(0.0, float(event["at_s"]))
    if event.get("kind") == "gap":
        return SessionEvent(at_s, "gap", f"{event.get('frames', 'some')} frames did not arrive")
    if event.get("kind") == "filled" or "clock_uncertainty_ns" in event or not sentence:
        return None
    if "mark" in event:
        return SessionEvent(at_s, "mark", sentence)
    criterion = sentence.startswith(("start criterion", "stop criterion"))
    criterion |= event.get("kind") in _SURFACE_CHANGES
    return SessionEvent(at_s, "criterion" if criterion else "other", sentence)


class LinkRecord:
    """Statistics of the link in a recording.

    Parameters
    ----------
    events
        Events of the recording, in order.
    """

    def __init__(self, events: Sequence[JsonObject]) -> None:
        self._clocks = [event for event in events if compares_clocks(event)]
        self._steps_s = [event["at_s"] for event in events if "clock_step_ns" in event]
        self._gaps = [event for event in events if event.get("kind") in ("gap", "filled")]

    @property
    def exists(self) -> bool:
        """Whether the recording has any such statistics."""
        return bool(self._clocks or self._gaps)

    def at(self, time_s: float, arrivals: IntArray) -> dict[str, Any]:
        """Return the statistics at a recording time.

        Parameters
        ----------
        time_s
            Recording time; later events are ignored.
        arrivals
            Shape (m, 2), of the blocks of the last seconds; see `mmt.session.windows.Window`.
        """
        past = [event for event in self._gaps if event["at_s"] <= time_s]
        missed = sum(_count(event, "frames") for event in past if event["kind"] == "gap")
        filled = [event for event in past if event["kind"] == "filled"]
        lost = sum(_count(event, "lost") for event in filled)
        table: dict[str, Any] = {
            "missed": missed,
            "filled": sum(_count(event, "frames") for event in filled) - lost,
            "lost": lost,
            "clock": None,
        }
        if not self._clocks:
            return table
        steps = bisect_right(self._steps_s, time_s)
        clock = min(
            self._clocks,
            key=lambda event: (
                bisect_right(self._steps_s, event["at_s"]) != steps,  # the other side of a jump
                abs(float(event["at_s"]) - time_s),
            ),
        )
        latencies_ms = _latencies_ms(clock, arrivals)
        edges = np.array([-np.inf, *LATENCY_MS, np.inf])
        table["clock"] = {
            "offset_ms": float(clock["clock_offset_ns"]) / 1e6,
            "drift_ppm": float(clock["clock_drift_ppm"]),
            "uncertainty_ms": float(clock["clock_uncertainty_ns"]) / 1e6,
        }
        if len(latencies_ms):
            p50, p99 = np.percentile(latencies_ms, [50, 99]).tolist()
            table |= {"latency_p50_ms": p50, "latency_p99_ms": p99}
        table["bounds_ms"] = list(LATENCY_MS)
        table["counts"] = np.histogram(latencies_ms, edges)[0].tolist()
        return table


def _latencies_ms(clock: Mapping[str, Any], arrivals: IntArray) -> FloatArray:
    """Return the latencies of blocks, given a comparison of the two clocks."""
    came_ns, sent_ns = arrivals.T
    return np.asarray((came_ns - sent_ns + clock_offset_ns(clock, came_ns)) / 1e6)


def _count(event: JsonObject, name: str) -> int:
    value = event.get(name, 0)
    return value if isinstance(value, int) else 0
