"""Who moves the robot: the leader's own hand, a listener's, or nobody while it changes.

Between any two hands the robot holds. Nothing here knows a network or a clock: what happens is
told by calls, time passes by `HandOver.tick`.
"""

from collections import deque
from typing import Final, Literal, NamedTuple

from mmt.core.errors import InputError

State = Literal["own", "giving", "given", "returning"]
"""The leader's hand moves the robot; it holds until the new operator's motion comes; a listener's
hand moves it; it holds until the leader's hand may go on."""

_MOST_ASKING: Final = 20


What = Literal["asked", "refused", "giving", "given", "moves", "ended", "back"]
"""A listener asks, or is refused; control goes to it, it may move, it moves; its control is over;
the leader's hand moves the robot again."""


class Change(NamedTuple):
    """What a person and an operator are to be told."""

    what: What
    who: int
    """Number of the listener, 0 for none."""
    name: str
    grant: int
    why: str = ""


class HandOver:
    """The states of control, and what leads from one to the next.

    Parameters
    ----------
    hold_ticks
        The robot holds for at least this long between two hands: the fade of force and vibration.
    silence_ticks
        An operator that sends nothing for this long has lost control.
    """

    def __init__(self, *, hold_ticks: int, silence_ticks: int) -> None:
        self._hold_ticks = hold_ticks
        self._silence_ticks = silence_ticks
        self._held_ticks = self._silent_ticks = 0
        self._may_move = False
        self._names: dict[int, str] = {}
        self.state: State = "own"
        self.grant = 0
        """Number of the newest grant."""
        self.operator: int | None = None
        """Number of the listener that control is given to."""
        self.asking: dict[int, str] = {}
        """Names of the listeners that ask, by number, who waits longest first."""
        self.holds = self.refusals = 0
        """How often the robot was held between two hands, and how often somebody was refused."""
        self.changes: deque[Change] = deque()
        """What has happened and was not taken from here yet."""

    @property
    def name(self) -> str:
        """Name of the operator, empty where there is none."""
        return "" if self.operator is None else self._names[self.operator]

    def ask(self, who: int, name: str) -> None:
        """Note that a listener asks for control; once until it is answered."""
        if who in self.asking or who == self.operator:
            return
        if len(self.asking) >= _MOST_ASKING:
            self._tell("refused", who, name, "too many ask at once")
            return
        self.asking[who] = name
        self._tell("asked", who, name)

    def leave(self, who: int, why: str) -> None:
        """Note that a listener has gone, or asks no more, or gives control back."""
        self.asking.pop(who, None)
        if who == self.operator:
            self._end(why)

    def refuse(self, who: int) -> None:
        """Refuse who asks.

        Raises
        ------
        InputError
            It does not ask.
        """
        self._tell("refused", who, self._asker(who))

    def give(self, who: int) -> None:
        """Give control to who asks: the robot holds, until this one's motion comes.

        Raises
        ------
        InputError
            It does not ask.
        """
        name = self._asker(who)
        if self.operator is not None:
            self._end("control went to another")
        self.grant += 1
        self.operator, self._names = who, {who: name}
        self._hold("giving")
        self._tell("giving", who, name)

    def take_back(self, why: str) -> None:
        """Give control back to the leader's own hand."""
        if self.operator is not None:
            self._end(why)

    def accepts(self, who: int, grant: int) -> bool:
        """Note motion; return whether it is that of the operator under the newest grant."""
        if not self._may_move or who != self.operator or grant != self.grant:
            return False
        self._silent_ticks = 0
        if self.state == "giving":
            self.state = "given"
            self._tell("moves", who, self.name)
        return True

    def tick(self, elapsed: int) -> None:
        """Let ticks pass."""
        if self.state == "own":
            return
        if self._may_move:
            self._silent_ticks += elapsed
            if self._silent_ticks > self._silence_ticks:
                self._end("the operator is silent")
            return
        self._held_ticks += elapsed
        if self._held_ticks < self._hold_ticks:
            return
        if self.operator is None:
            self.state = "own"
            self._tell("back", 0, "")
        else:
            self._may_move = True
            self._tell("given", self.operator, self.name)

    def _asker(self, who: int) -> str:
        if who not in self.asking:
            raise InputError("this listener does not ask for control, or has gone")
        return self.asking.pop(who)

    def _end(self, why: str) -> None:
        assert self.operator is not None  # noqa: S101 - the callers have looked
        self._tell("ended", self.operator, self.name, why)
        self.operator = None
        self._hold("returning")

    def _hold(self, state: State) -> None:
        self.holds += self.state in {"own", "given"}
        self.state = state
        self._held_ticks = self._silent_ticks = 0
        self._may_move = False

    def _tell(self, what: What, who: int, name: str, why: str = "") -> None:
        self.refusals += what == "refused"
        self.changes.append(Change(what, who, name, self.grant, why))
