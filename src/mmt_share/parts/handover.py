"""State machine of control: the leader's hand moves the robot, or a listener's, or none.

Between any two hands the robot holds. Nothing here uses a network or a clock: the caller reports
events, and time passes by `HandOver.tick`.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

from mmt.core.errors import InputError

if TYPE_CHECKING:
    from prometheus_client.core import Metric

State = Literal["own", "giving", "given", "returning"]
"""In this order: the leader's hand moves the robot; the robot holds until the operator's motion
comes; the operator's hand moves it; the robot holds until the leader's hand may go on."""

_MOST_ASKING: Final = 20


What = Literal["asked", "refused", "giving", "given", "moves", "ended", "back"]
"""In this order: a listener asks, is refused, is given control, may move, moves; its control ends;
the leader's hand moves the robot again."""


class Change(NamedTuple):
    """A change of control, to be told to people and to the operator."""

    what: What
    who: int
    """Number of the listener, 0 for none."""
    name: str
    grant: int
    why: str = ""


class HandOver:
    """The states of control, and the transitions between them.

    Parameters
    ----------
    tell
        Called with each change, after the states have changed.
    hold_ticks
        Least time that the robot holds between two hands, in which force and vibration fade.
    silence_ticks
        An operator that sends no motion for this long loses control.
    """

    def __init__(
        self, tell: Callable[[Change], None], *, hold_ticks: int, silence_ticks: int
    ) -> None:
        self._tell = tell
        self._hold_ticks = hold_ticks
        self._silence_ticks = silence_ticks
        self._held_ticks = self._silent_ticks = 0
        self._may_move = False
        self.state: State = "own"
        self.grant = 0
        """Number of the newest grant."""
        self.operator: int | None = None
        """Number of the listener that control is given to, or None."""
        self.name = ""
        """Name of the operator, empty if there is none."""
        self.asking: dict[int, str] = {}
        """Names of the listeners that ask, by number, the longest waiting first."""
        self.holds = self.refusals = 0
        """How often the robot was held between two hands, and how often a request was refused."""

    def request_control(self, who: int, name: str) -> None:
        """Note that a listener asks for control, unless it asks already or is the operator."""
        if who in self.asking or who == self.operator:
            return
        if len(self.asking) >= _MOST_ASKING:
            self._record_change("refused", who, name, "too many ask at once")
            return
        self.asking[who] = name
        self._record_change("asked", who, name)

    def leave(self, who: int, why: str) -> None:
        """Note that a listener has left, withdraws its request, or gives control back."""
        self.asking.pop(who, None)
        if who == self.operator:
            self._end(why)

    def refuse(self, who: int) -> None:
        """Refuse control to a listener.

        Raises
        ------
        InputError
            The listener does not ask.
        """
        self._record_change("refused", who, self._asker(who))

    def grant_control(self, who: int) -> None:
        """Give control to a listener: the robot holds until the listener's motion comes.

        Raises
        ------
        InputError
            The listener does not ask.
        """
        name = self._asker(who)
        if self.operator is not None:
            self._end("control went to another")
        self.grant += 1
        self.operator, self.name = who, name
        self._hold("giving")
        self._record_change("giving", who, name)

    def revoke_control(self, why: str) -> None:
        """Give control back to the leader's own hand."""
        if self.operator is not None:
            self._end(why)

    def accepts(self, who: int, grant: int) -> bool:
        """Note motion; return whether it comes from the operator, under the newest grant."""
        if not self._may_move or who != self.operator or grant != self.grant:
            return False
        self._silent_ticks = 0
        if self.state == "giving":
            self.state = "given"
            self._record_change("moves", who, self.name)
        return True

    def tick(self, elapsed: int) -> None:
        """Advance the time by ticks."""
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
            self._record_change("back", 0, "")
        else:
            self._may_move = True
            self._record_change("given", self.operator, self.name)

    def _asker(self, who: int) -> str:
        if who not in self.asking:
            raise InputError("this listener does not ask for control, or has gone")
        return self.asking.pop(who)

    def _end(self, why: str) -> None:
        who, name = self.operator, self.name
        assert who is not None  # noqa: S101 - the callers have looked
        self.operator, self.name = None, ""
        self._hold("returning")
        self._record_change("ended", who, name, why)

    def _hold(self, state: State) -> None:
        self.holds += self.state in {"own", "given"}
        self.state = state
        self._held_ticks = self._silent_ticks = 0
        self._may_move = False

    def _record_change(self, what: What, who: int, name: str, why: str = "") -> None:
        self.refusals += what == "refused"
        self._tell(Change(what, who, name, self.grant, why))


def control_metrics(now: State, figures: Mapping[str, Any]) -> Iterator["Metric"]:
    """Yield metrics of whose hand moves the robot, and of how often and long control was away."""
    from mmt.core.output.exposition import counter, state

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
