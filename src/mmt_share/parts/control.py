"""The part that hands control of the robot to a listener, and takes it back."""

import time
from typing import TYPE_CHECKING, Any, Final

from mmt.core.arrays import Vector, difference, step_towards
from mmt.core.errors import InputError, printable
from mmt.core.guards import FADE_TICKS
from mmt.devices.leader_reports import InterfaceState
from mmt.leader.part import Part, Session, Tick
from mmt.scene import Link
from mmt_share.control_messages import (
    ControlNews,
    SharedContact,
    control_access,
    decode_motion,
)
from mmt_share.parts.hand_motion import Clutch, OperatorMotion
from mmt_share.parts.handover import Change, HandOver, control_metrics
from mmt_share.parts.sharing import SharingPart
from mmt_share.tables import Control

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from prometheus_client.core import Metric

    from mmt.leader.building import LeaderParts
    from mmt.leader.motion.feedback import StreamedForce
    from mmt.leader.motion.hand import HandPart

_CONTACT_TICKS: Final = 50
_DECISIONS: Final = {
    "give": "control is given: the robot holds first",
    "refuse": "control is refused",
    "take back": "control is taken back: the robot holds first",
}
"""Decisions of a person on the monitor's page, and the answers to them."""
_SENTENCES: Final = {
    "asked": "{name} asks for control",
    "refused": "control refused to {name}",
    "giving": "control goes to {name}: the robot holds",
    "moves": "{name} moves the robot",
    "ended": "control taken from {name}: {why}; the robot holds",
    "back": "the leader's hand moves the robot",
}


class ControlPart(Part):
    """Command the robot in each tick: by the leader's hand, by a listener's, or to hold.

    Parameters
    ----------
    session
        Session of the run; it has a hand, a link, and shares its model.
    table
        The scene's ``[control]``.
    hand
        The leader's hand, which this part gives the command.
    sharing
        Sends messages to the listeners.
    feedback
        Force feedback of the leader's own hand, or None.

    Raises
    ------
    InputError
        There is no token for control.
    """

    def __init__(
        self,
        session: Session,
        table: Control,
        hand: "HandPart",
        sharing: "SharingPart",
        feedback: "StreamedForce | None",
    ) -> None:
        control_access(table.token_file)  # raises now; the listeners' process would later
        self._session = session
        rate_hz, link = session.rate_hz, session.scene.link or Link()
        self._period_s = 1.0 / rate_hz
        self._recovery_mm_s = link.recovery_mm_s
        self._limit_mm = link.limit_mm_s / rate_hz
        self._silence_ns = round(table.silence_ms * 1e6)
        self._over = HandOver(
            self._report,
            hold_ticks=FADE_TICKS,
            silence_ticks=round(table.silence_ms * rate_hz / 1000),
        )
        self._motion = OperatorMotion(self._silence_ns)
        self._clutch: Clutch | None = None
        self._command_mm: Vector | None = None
        self._contact_ticks = 0
        self._normal = "xyz".index(session.scene.normal)
        self._sharing, self._feedback = sharing, feedback
        sharing.on_control = self.receive
        hand.control = self
        self._grants = self._messages = self._refused = self._given_ticks = self._held_ticks = 0

    @classmethod
    def build(cls, session: Session, parts: "LeaderParts") -> "ControlPart | None":
        """Return the part, or None if the scene has no ``[control]``, hand or ``[sharing]``."""
        table, hand = session.scene.table(Control), parts.hand
        sharing = parts.get(SharingPart)
        if table is None or hand is None or sharing is None:
            return None
        displayed = parts.force_feedback
        feedback = None if displayed is None else displayed.feedback
        return cls(session, table, hand, sharing, feedback)

    # --- decisions of a person

    def shown(self) -> dict[str, dict[str, Any]]:
        """Return who has control, and who asks for it."""
        over = self._over
        asking = [[who, name] for who, name in over.asking.items()]
        return {"control": {"state": over.state, "operator": over.name, "asking": asking}}

    def orders(self) -> "dict[str, Callable[[dict[str, Any]], str]]":
        """Return the order that gives, refuses or takes back control."""
        return {"control": self._decide}

    def signals(self) -> "dict[str, Callable[[], None]]":
        """Return the signal that gives control or takes it back."""
        return {"SIGUSR2": self.toggle}

    def _decide(self, order: dict[str, Any]) -> str:
        """Carry out an order, which is not trusted; see `orders`."""
        decision, who = order.get("decision"), order.get("who", 0)
        if decision not in tuple(_DECISIONS):  # it may be no hashable value
            raise InputError(f"decision is {decision!r}: allowed are {', '.join(_DECISIONS)}")
        if not isinstance(who, int):
            raise InputError("who is the number of a listener that asks")
        if decision == "take back":
            self.revoke_control()
        elif decision == "give":
            self.grant_control(who)
        else:
            self._over.refuse(who)
        return _DECISIONS[decision]

    def grant_control(self, who: int) -> None:
        """Give control to a listener that asks for it.

        Raises
        ------
        InputError
            The listener does not ask, or no robot is connected.
        """
        remote = self._session.remote
        if self._command_mm is None or remote is None or not remote.connected:
            raise InputError("there is no robot to give control of: start the follower")
        self._over.grant_control(who)
        self._motion, self._clutch = OperatorMotion(self._silence_ns), None
        self._grants += 1

    def revoke_control(self) -> None:
        """Give control back to the leader's hand."""
        self._over.revoke_control("the leader has taken it back")

    def toggle(self) -> None:
        """Take control back, or give it to the listener that has asked for longest."""
        over, tell = self._over, self._session.journal.event
        if over.operator is not None:
            self.revoke_control()
        elif not over.asking:
            tell("nobody asks for control")
        else:
            try:
                self.grant_control(next(iter(over.asking)))
            except InputError as error:
                tell(str(error))

    # --- messages from the listeners' process

    def receive(self, line: dict[str, Any]) -> None:
        """Handle a message of an operator, which is not trusted."""
        who = line["who"]
        match line["control"]:
            case "ask":
                self._over.request_control(who, printable(line["name"]) or f"listener {who}")
            case "release":
                self._over.leave(who, "it was given back")
            case "gone":
                self._over.leave(who, "the operator is lost")
            case "refused":  # by the process
                self._refused += line["count"]
            case "motion":
                self._receive_motion(who, bytes.fromhex(line["data"]))

    def _receive_motion(self, who: int, data: bytes) -> None:
        try:
            grant, records = decode_motion(data)
        except InputError:
            self._refused += 1
            return
        if not self._over.accepts(who, grant):
            self._refused += 1
            return
        self._messages += 1
        self._motion.add(records, time.monotonic_ns())

    # --- while it runs

    @property
    def overridden(self) -> bool:
        """Whether the robot does not follow the leader's hand now."""
        return self._over.state != "own"

    def command(self, tick: Tick, own_mm: Vector | None) -> Vector | None:
        """Return the robot's command (mm), or None before the first.

        Parameters
        ----------
        tick
            With the state of the leader's hand; the operator's state and the offset are filled in.
        own_mm
            Position that the leader's own hand asks for, or None before the hand was read.
        """
        over = self._over
        if over.state == "own":
            return self._follow_own(tick, own_mm)
        self._given_ticks += tick.elapsed
        hand = self._motion.at(tick.now_ns) if over.state == "given" else None
        if hand is None or self._command_mm is None:
            self._held_ticks += tick.elapsed
            self._clutch = None
            return self._command_mm
        self._command_mm = self._follow(hand, self._command_mm, tick.elapsed)
        tick.operating = hand._replace(position_mm=self._command_mm)
        return self._command_mm

    def _follow_own(self, tick: Tick, own_mm: Vector | None) -> Vector | None:
        """Command the position of the leader's hand, plus the offset since control was away."""
        state = tick.state
        if own_mm is None:
            return self._command_mm
        if self._grants == 0 or self._command_mm is None:
            self._command_mm = own_mm
            return own_mm
        still = InterfaceState(own_mm, (0.0, 0.0, 0.0), 0.0, contact=False)
        hand = still if state is None else state._replace(position_mm=own_mm)
        self._command_mm = self._follow(hand, self._command_mm, tick.elapsed)
        tick.offset_mm = difference(self._command_mm, own_mm)
        return self._command_mm

    def _follow(self, hand: InterfaceState, command_mm: Vector, elapsed: int) -> Vector:
        """Return the command that follows a hand, no faster than the robot may move."""
        if self._clutch is None:
            self._clutch = Clutch(command_mm, hand.position_mm, self._recovery_mm_s)
        wanted_mm = self._clutch.step(hand, elapsed * self._period_s)
        return step_towards(command_mm, wanted_mm, self._limit_mm * elapsed)

    def tick(self, tick: Tick) -> None:
        """Advance the time, and send the operator the contact for its own force."""
        over = self._over
        over.tick(tick.elapsed)
        if over.operator is None:
            return
        self._contact_ticks += tick.elapsed
        if self._contact_ticks >= _CONTACT_TICKS:
            self._contact_ticks = 0
            self._sharing.send_to(over.operator, self._contact().encode())

    def _contact(self) -> SharedContact:
        model = None if self._feedback is None else self._feedback.contact_model
        table = self._session.scene.force_feedback
        return SharedContact(model, self._normal, 0.0 if table is None else table.limit_n)

    def _report(self, change: Change) -> None:
        """Report and record a change of control, and send it to the listener concerned."""
        if change.what in _SENTENCES:
            details: dict[str, object] = {"control": change.what, "grant": change.grant}
            if change.name:
                details["operator"] = change.name
            sentence = _SENTENCES[change.what].format(name=change.name, why=change.why)
            self._session.journal.event(sentence, **details)
        if change.what in {"asked", "refused", "given", "ended"}:
            hold = self._command_mm or (0.0, 0.0, 0.0)
            news = ControlNews(change.what, change.grant, hold, self._recovery_mm_s, change.why)
            self._sharing.admit_motion(self._over.operator)
            self._sharing.send_to(change.who, news.encode())

    # --- reports

    def status(self) -> dict[str, Any]:
        """Return who moves the robot."""
        return {"control": self._over.name or self._over.state}

    def metrics(self) -> "Iterable[Metric]":
        """Return metrics of whose hand moves the robot, and of how often that has changed."""
        return control_metrics(self._over.state, self._figures())

    def summary(self, _duration_s: float) -> dict[str, Any]:
        """Return figures of control, and the delay of the operator's motion."""
        delay_ms = round(self._motion.delay_ms, 1)
        return {"control": {**self._figures(), "delay_ms": delay_ms}}

    def _figures(self) -> dict[str, Any]:
        return {
            "grants": self._grants,
            "refusals": self._over.refusals,
            "holds": self._over.holds,
            "given_s": round(self._given_ticks * self._period_s, 3),
            "held_s": round(self._held_ticks * self._period_s, 3),
            "messages": self._messages,
            "refused_messages": self._refused,
        }
