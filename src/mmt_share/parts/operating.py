"""The part that lets this hand move another leader's robot."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from mmt.core.arrays import Vector
from mmt.leader.part import Part, Session, Tick
from mmt_share.control_messages import ControlNews, control_access
from mmt_share.operator import OperatorClient
from mmt_share.parts.hand_motion import Clutch
from mmt_share.tables import Operating

if TYPE_CHECKING:
    from mmt.core.guards import ForceDisplay
    from mmt.leader.building import LeaderParts
    from mmt.leader.motion.feedback import StreamedForce
    from mmt.leader.motion.feedback_model import ModelSettings
    from mmt.leader.motion.hand_contact import FollowerContact


class OperatingPart(Part):
    """Ask for control, and send the hand's motion while this hand has control.

    Parameters
    ----------
    session
        Session of the run, with a hand and ``[listening]``.
    table
        The scene's ``[operating]``.
    contact
        Gives the hand's force, if its handle measures none.

    Raises
    ------
    InputError
        There is no token for control.
    """

    def __init__(
        self, session: Session, table: Operating, contact: "FollowerContact | None" = None
    ) -> None:
        self._contact = contact
        self._period_s = 1.0 / session.rate_hz
        self.client = OperatorClient(control_access(table.token_file), session.journal.event)
        self._news: ControlNews | None = None
        self._clutch: Clutch | None = None
        self._grants = 0

    @classmethod
    def build(cls, session: Session, parts: "LeaderParts") -> "OperatingPart | None":
        """Return the part, or None without ``[operating]``; the part also displays the force."""
        table = session.scene.table(Operating)
        if table is None:
            return None
        part = cls(session, table, None if parts.hand is None else parts.hand.contact)
        parts.other_force = part.display
        return part

    def display(
        self, interface: "ForceDisplay", *, limit_n: float, settings: "ModelSettings"
    ) -> "StreamedForce":
        """Return the display of the force; see `mmt.leader.motion.feedback_part.OtherForce`."""
        from mmt_share.parts.feedback_shared import SharedContactForce

        return SharedContactForce(interface, self.client, limit_n=limit_n, settings=settings)

    def signals(self) -> dict[str, Callable[[], None]]:
        """Return the signal that asks for control or gives it back."""
        return {"SIGUSR2": self.toggle}

    def toggle(self) -> None:
        """Ask for control, or give it back."""
        if self.client.wants:
            self.client.release()
        else:
            self.client.request_control()

    def tick(self, tick: Tick) -> None:
        """Send the robot's wanted position, which begins where the robot holds."""
        client, state = self.client, tick.state
        if client.news is not self._news:
            self._news, self._clutch = client.news, None
            self._grants += client.operates
        if self._news is None or not client.operates or state is None:
            return
        if self._clutch is None:
            news = self._news
            self._clutch = Clutch(news.hold_mm, state.position_mm, news.recovery_mm_s)
        robot_mm: Vector = self._clutch.step(state, tick.elapsed * self._period_s)
        tick.offset_mm = self._clutch.offset_mm
        if self._contact is not None:
            shared = None if client.contact is None else client.contact.model
            state = tick.state = self._contact.state_of(state, robot_mm, shared)
        client.put(tick.now_ns, robot_mm, state.velocity_mm_s, state.force_n, contact=state.contact)

    def status(self) -> dict[str, Any]:
        """Return the state of control."""
        news = self.client.news
        return {"control": None if news is None else news.state}

    def summary(self, _duration_s: float) -> dict[str, Any]:
        """Return how often control was given, and how much was sent."""
        client = self.client
        return {
            "operating": {
                "grants": self._grants,
                "records": client.records,
                "contacts": client.contacts,
                "rejected": client.rejected,
            }
        }
