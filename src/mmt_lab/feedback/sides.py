"""Leader's and follower's side of a method of force feedback, built as in the services."""

from dataclasses import dataclass
from typing import Final, Literal

from mmt.contact.passivity import PassivitySettings
from mmt.core.arrays import Vector
from mmt.core.guards import ForceDisplay
from mmt.devices.leader_reports import InterfaceState
from mmt.follower.feedback import FollowerFeedback
from mmt.follower.feedback import build_feedback as build_follower_feedback
from mmt.leader.motion.feedback import StreamedForce
from mmt.leader.motion.feedback_part import build_feedback as build_leader_feedback
from mmt.scene import ForceFeedback, Hand, Link, Scene, Simulated
from mmt.testing.simulation import RATE_HZ

Method = Literal["streamed", "passive", "model"]

METHODS: Final[tuple[Method, ...]] = ("streamed", "passive", "model")

PASSIVITY: Final = PassivitySettings()
"""The scene's defaults."""

_NEVER_TICKS: Final = 10**9
"""Silence limit that is never reached, since delays are deliberate here."""


@dataclass(frozen=True)
class Sides:
    """The leader's part, and the follower's part or None if the method has none."""

    leader: StreamedForce
    follower: FollowerFeedback | None


def make_sides(
    method: Method, interface: ForceDisplay, *, limit_n: float, opening_j: float = 0.0
) -> Sides:
    """Return both sides of a method, with the scene's defaults."""
    table = ForceFeedback(method=method, limit_n=limit_n)
    scene = Scene(link=Link(), simulated=Simulated(), hand=Hand(), force_feedback=table)
    leader = build_leader_feedback(
        table,
        interface,
        rate_hz=RATE_HZ,
        normal="z",
        silence_ticks=_NEVER_TICKS,
        opening_j=opening_j,
    )
    return Sides(leader, build_follower_feedback(scene))


class Display:
    """Force display that keeps the last force along the normal."""

    def __init__(self) -> None:
        self.force_n = 0.0

    def write(self, force_n: Vector) -> None:
        """Remember a force."""
        self.force_n = force_n[2]


def handle_state(height_m: float, speed_m_s: float = 0.0) -> InterfaceState:
    """Return the state of a handle along the normal."""
    return InterfaceState((0.0, 0.0, 1e3 * height_m), (0.0, 0.0, 1e3 * speed_m_s), 0.0, True)
