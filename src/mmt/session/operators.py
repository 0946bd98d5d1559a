"""Periods of control of the robot in a recorded session, from its events about control."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from mmt.core.errors import printable
from mmt.session.data import JsonObject

Control = Literal["own", "held", "given"]
"""The leader's own hand moves the robot ("own"), no hand ("held"), a listener's hand ("given")."""

_LEADS_TO: Final[dict[str, Control]] = {
    "giving": "held",
    "moves": "given",
    "ended": "held",
    "back": "own",
}


@dataclass(frozen=True)
class ControlPeriod:
    """A period during which one hand, or none, moved the robot.

    ``state``: `Control`. ``operator``: the listener's name, or None unless the state is "given".
    ``from_s`` and ``to_s``: session times.
    """

    state: Control
    operator: str | None
    from_s: float
    to_s: float

    @property
    def hand(self) -> str:
        """Description of the hand for people."""
        if self.state == "given":
            return f"listener {self.operator}" if self.operator else "a listener"
        return "the leader's" if self.state == "own" else "none"

    def as_dict(self) -> dict[str, Any]:
        """Return the period as JSON-serializable values, times rounded to 1 ms."""
        times = {"from_s": round(self.from_s, 3), "to_s": round(self.to_s, 3)}
        return {"state": self.state, "operator": self.operator, **times}


def control_periods(events: Iterable[JsonObject], duration_s: float) -> tuple[ControlPeriod, ...]:
    """Divide a session into periods of control of the robot.

    Parameters
    ----------
    events
        Events of the session, in order.
    duration_s
        Length of the session.

    Returns
    -------
    tuple
        Consecutive periods; empty if control never changed hands.
    """
    periods = [ControlPeriod("own", None, 0.0, duration_s)]
    for event in events:
        state, at_s = _LEADS_TO.get(str(event.get("control"))), event.get("time_s")
        last = periods[-1]
        if state is None or state == last.state or not isinstance(at_s, int | float):
            continue
        at_s = min(max(last.from_s, float(at_s)), duration_s)  # NaN becomes last.from_s
        operator = printable(str(event.get("operator", ""))) if state == "given" else None
        periods[-1] = replace(last, to_s=at_s)
        periods.append(ControlPeriod(state, operator, at_s, duration_s))
    return tuple(periods) if len(periods) > 1 else ()


def control_sentence(periods: Iterable[ControlPeriod]) -> str:
    """Return a sentence with the time for which each hand moved the robot; "" without periods."""
    lengths: dict[str, float] = {}
    for period in periods:
        lengths[period.hand] = lengths.get(period.hand, 0.0) + period.to_s - period.from_s
    if not lengths:
        return ""
    spent = ", ".join(f"{hand} for {length_s:.1f} s" for hand, length_s in lengths.items())
    return f"Hands that moved the robot: {spent}."
