"""The list of hubs, and the choice of the feeder, which takes the model from the leader.

Each hub sends the others a beat once a second. The feeder is connected to the leader and passes its
messages on to the others. If there is no feeder, the oldest hub that can reach the leader becomes
it; if there are two, the older one stays. There is no voting: for a moment two hubs may feed, or
none. This does no harm, because the messages are numbered.
"""

from dataclasses import dataclass
from typing import Annotated, Final

from pydantic import Field

from mmt_share.messages import Flag, Name, PeerMessage, Text

BEAT_S: Final = 1.0
"""Time between two beats of a hub."""
LOST_S: Final = 2.0
"""A hub without a beat for this long is gone."""
FIRST_S: Final = 1.5
"""How long a new hub waits for the beats of others before it connects to the leader."""
TURN_S: Final = 1.0
"""Each younger hub waits this much longer than the next older one before it connects."""


@dataclass(frozen=True)
class Heartbeat(PeerMessage):
    """Message that a hub sends to the others once a second.

    Attributes
    ----------
    id
        Name of the hub; names sort by age, the oldest hub first.
    address
        Address for listeners.
    listeners
        Number of its listeners.
    feeding
        Whether it is connected to the leader.
    session_id, number
        Session and number of its newest state of the model.
    leaving
        Whether this is its last beat.
    """

    title = "a hub's beat"

    id: Name
    address: Annotated[Text, Field(pattern="^https?://")]
    listeners: int = 0
    feeding: Flag = False
    session_id: Name = ""
    number: int = 0
    leaving: Flag = False


class Peers:
    """The other hubs, known by their beats.

    Parameters
    ----------
    own_id
        Name of this hub.
    now_s
        Monotonic time at its start.
    """

    def __init__(self, own_id: str, now_s: float) -> None:
        self._own_id = own_id
        self._heard: dict[str, tuple[float, Heartbeat]] = {}
        self._unfed_since_s = now_s + FIRST_S

    def record_heartbeat(self, beat: Heartbeat, now_s: float) -> None:
        """Note the beat of another hub."""
        if beat.leaving:
            self._heard.pop(beat.id, None)
        elif beat.id != self._own_id:
            self._heard[beat.id] = now_s, beat

    def alive(self, now_s: float) -> list[Heartbeat]:
        """Return the newest beat of each other hub that is there, the oldest hub first."""
        gone = [id_ for id_, (heard_s, _) in self._heard.items() if now_s - heard_s > LOST_S]
        for id_ in gone:
            del self._heard[id_]
        return sorted((beat for _, beat in self._heard.values()), key=lambda beat: beat.id)

    def should_feed(self, now_s: float, *, feeding: bool) -> bool:
        """Whether this hub should be connected to the leader; `feeding` says whether it is now."""
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
