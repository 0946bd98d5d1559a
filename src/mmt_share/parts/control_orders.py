"""What a person decides on the monitor's page of who moves the robot."""

from typing import Any, Final, Protocol

from mmt.core.errors import InputError

DECISIONS: Final = {
    "give": "control is given: the robot holds first",
    "refuse": "control is refused",
    "take back": "control is taken back: the robot holds first",
}
"""What is decided, and what a person is answered."""


class Decided(Protocol):
    """What can be decided of control."""

    def give(self, who: int) -> None:
        """Give it to a listener that asks for it."""

    def refuse(self, who: int) -> None:
        """Refuse it to a listener that asks for it."""

    def take_back(self) -> None:
        """Give it back to the leader's hand."""


def carry_out(control: Decided, order: dict[str, Any]) -> str:
    """Carry out an order, which is not trusted: its ``decision``, and ``who`` is meant.

    Raises
    ------
    InputError
        It makes no sense, that listener does not ask, or no robot is there.
    """
    decision, who = order.get("decision"), order.get("who", 0)
    if decision not in DECISIONS:
        raise InputError(f"decision is {decision!r}: allowed are {', '.join(DECISIONS)}")
    if not isinstance(who, int):
        raise InputError("who is the number of a listener that asks")
    if decision == "take back":
        control.take_back()
    else:
        (control.give if decision == "give" else control.refuse)(who)
    return DECISIONS[decision]
