"""Whose hand moves the robot, as metrics for Prometheus."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt_share.parts.handover import State


def control_metrics(now: "State", figures: Mapping[str, Any]) -> Iterator["Metric"]:
    """Yield metrics of whose hand moves the robot, and of how often and long control was away."""
    from mmt.core.exposition import counter, state

    hand = {"own": "leader", "given": "listener"}.get(now, "none")
    text = "Whose hand moves the robot; none while it holds."
    yield state("operating_hand", text, "hand", hand, ("leader", "listener", "none"))
    for name, text, key in (
        ("hand_overs", "How often control was given to a listener.", "grants"),
        ("control_refusals", "Requests for control that were refused.", "refusals"),
        ("control_refused_messages", "Motion and requests that were left out.", "refused_messages"),
        ("control_holds", "How often the robot has held between two hands.", "holds"),
        ("control_held_seconds", "Time in which it held.", "held_s"),
        ("control_given_seconds", "Time in which control was away, holds included.", "given_s"),
    ):
        yield counter(name, text, figures[key])
