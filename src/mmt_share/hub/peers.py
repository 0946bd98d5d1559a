"""Which hubs there are, and which of them takes the model from the leader.

Each hub tells the others once a second that it is there. One of them, the feeder, is connected to
the leader, and hands on to the others what comes. Where none is, the oldest hub that can reach the
leader becomes it; where two are, the older one stays. Nothing is agreed on: for a moment two hubs
may feed, or none, and what they hand on is numbered, so that neither does any harm.
"""

from dataclasses import dataclass
from typing import Any, Final, Self

from mmt.core.errors import InputError
from mmt.core.printable import printable
from mmt_share.messages import LONGEST_ADDRESS, LONGEST_NAME

BEAT_S: Final = 1.0
"""Time between two beats of a hub."""
LOST_S: Final = 2.0
"""A hub without a beat for this long is gone."""
FIRST_S: Final = 1.5
"""How long a new hub waits for the beats of others before it turns to the leader."""
TURN_S: Final = 1.0
"""By how much sooner than the next younger hub an older one turns to the leader."""


@dataclass(frozen=True)
class Beat:
    """What a hub tells the others of itself.

    Attributes
    ----------
    id
        Its name; an older hub's comes first in alphabetical order.
    address
        Where listeners connect.
    listeners
        How many it has.
    feeding
        Whether it is connected to the leader.
    session_id, number
        Of the newest state of the model that it has.
    leaving
        Whether this is its last beat.
    """

    id: str
    address: str
    listeners: int = 0
    feeding: bool = False
    session_id: str = ""
    number: int = 0
    leaving: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return it as a map for the wire."""
        return dict(vars(self))

    @classmethod
    def from_message(cls, message: Any) -> Self:
        """Return what a hub tells.

        Raises
        ------
        InputError
            It is malformed.
        """
        try:
            beat = cls(
                id=printable(str(message["id"])[:LONGEST_NAME]),
                address=printable(str(message["address"])[:LONGEST_ADDRESS]),
                listeners=int(message["listeners"]),
                feeding=message["feeding"] is True,
                session_id=str(message["session_id"])[:LONGEST_NAME],
                number=int(message["number"]),
                leaving=message["leaving"] is True,
            )
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise InputError(f"a hub's beat is malformed: {error}") from error
        if not beat.address.startswith(("http://", "https://")):
            raise InputError(f"a hub's address is {beat.address!r}: none of http or https")
        return beat


class Peers:
    """The other hubs, as one of them knows them.

    Parameters
    ----------
    own_id
        Its own name.
    now_s
        Monotonic time at which it begins.
    """

    def __init__(self, own_id: str, now_s: float) -> None:
        self._own_id = own_id
        self._heard: dict[str, tuple[float, Beat]] = {}
        self._unfed_since_s = now_s + FIRST_S

    def hear(self, beat: Beat, now_s: float) -> None:
        """Note the beat of another hub."""
        if beat.leaving:
            self._heard.pop(beat.id, None)
        elif beat.id != self._own_id:
            self._heard[beat.id] = now_s, beat

    def alive(self, now_s: float) -> list[Beat]:
        """Return the newest beat of each other hub that is there, the oldest hub first."""
        gone = [id_ for id_, (heard_s, _) in self._heard.items() if now_s - heard_s > LOST_S]
        for id_ in gone:
            del self._heard[id_]
        return sorted((beat for _, beat in self._heard.values()), key=lambda beat: beat.id)

    def should_feed(self, now_s: float, *, feeding: bool) -> bool:
        """Whether this hub is to be connected to the leader, `feeding` whether it is."""
        others = self.alive(now_s)
        feeders = [beat for beat in others if beat.feeding]
        if feeding:
            self._unfed_since_s = now_s
            return not any(beat.id < self._own_id for beat in feeders)
        if feeders:
            self._unfed_since_s = now_s
            return False
        before = sum(beat.id < self._own_id for beat in others)
        return now_s - self._unfed_since_s >= before * TURN_S
