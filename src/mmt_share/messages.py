"""Messages between the server of a shared model and its listeners; ``docs/reference/sharing.md``.

All are Socket.IO events with the namespace and serializer of the link. Each state of the model has
a number, one higher than the state before. A listener first receives the whole model, then the
change from each number to the next. If it has missed a change, it requests the whole model again.
"""

from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any, ClassVar, Final, Self

import numpy as np
from annotated_types import Ge
from pydantic import AfterValidator, Strict, TypeAdapter, ValidationError

from mmt.core.errors import InputError, printable, short_message

SHARING_VERSION: Final = 1

TOKEN_VARIABLE: Final = "MMT_SHARING_TOKEN"  # noqa: S105 - the variable's name

WELCOME: Final = "welcome"
"""To a listener, at the start of each session: ``{"sharing": int, "session_id": str, "name": str,
"rate_hz": int}``."""
MODEL: Final = "model"
"""To a listener: the whole model, a map with a `ModelDescription` and the model's ``file``."""
CHANGE: Final = "change"
"""To a listener: a change, a map with a `ModelDescription`, the number ``since`` which it changes,
and the keys of `mmt_share.changes`."""
STATE: Final = "state"
"""To a listener, 20 times a second or at the lower rate that it asked for: `STATE_DTYPE`."""
END: Final = "end"
"""To a listener: ``{"outcome": str}``; the session is over."""
AGAIN: Final = "again"
"""From a listener, after `WELCOME` and after each missed change: request for the whole model."""

HAVE: Final = "have"
"""From a listener, in answer to the first eight states and then one a second: `ListenerState`."""
HUBS: Final = "hubs"
"""From a hub to a listener: a list of the other hubs' addresses, whenever it has changed. The same
list is in `WELCOME`, as ``hubs``."""
MOST_HUBS: Final = 64
"""Most addresses that a listener keeps."""

LONGEST_ADDRESS: Final = 256
LONGEST_TEXT: Final = 256
"""Characters of a text that are kept; of a name fewer."""
LONGEST_NAME: Final = 64
LONGEST_MESSAGE: Final = 4 << 20
"""Most bytes of a message to a listener; a model of a thousand samples has some 200,000."""

PING_S: Final = 5, 5
"""Seconds between two pings of a listener, and time-out of its answer. A ping costs as much time as
ten states. Only silent connections need pings: a closed one is noticed at once."""

HAND_FIELDS: Final = (
    ("position_mm", "<f4", 3),
    ("velocity_mm_s", "<f4", 3),
    ("force_n", "<f4"),
    ("contact", "u1"),
)
"""Fields of a hand's state beside its time."""
STATE_DTYPE: Final = np.dtype([("time_s", "<f8"), *HAND_FIELDS])
"""State of the hand that moves the robot, 37 bytes; `force_n` is its normal force."""

Text = Annotated[str, Strict(), AfterValidator(lambda text: printable(text[:LONGEST_TEXT]))]
"""A text of a peer."""
Name = Annotated[str, Strict(), AfterValidator(lambda text: printable(text[:LONGEST_NAME]))]
Flag = Annotated[bool, Strict()]


def parsed(kind: Any, given: object, what: str, *, strict: bool = False) -> Any:
    """Return what a peer has sent, which is not trusted, as a type with annotated bounds.

    Raises
    ------
    InputError
        It is malformed.
    """
    try:
        return adapter(kind).validate_python(given, strict=strict or None)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]  # it may be large
        place = ".".join(map(str, first["loc"]))[:LONGEST_TEXT]
        problem = short_message(f"{place} {first['msg']}")
        raise InputError(f"{what} is malformed: {problem}") from error


@cache
def adapter(kind: Any) -> TypeAdapter[Any]:
    """Return what checks values of a type; it is made in some 5 ms, too long between two ticks."""
    return TypeAdapter(kind)


class PeerMessage:
    """Base class of dataclasses that peers send each other as maps."""

    title: ClassVar[str]
    """Name of the message in errors."""
    may_lack: ClassVar[bool] = False
    """Whether fields may be absent that have a default."""

    @classmethod
    def from_message(cls, message: object) -> Self:
        """Parse a message, which is not trusted.

        Raises
        ------
        InputError
            It is malformed.
        """
        given = message if isinstance(message, dict) else {}
        if not cls.may_lack and (absent := sorted(cls.__annotations__.keys() - given.keys())):
            raise InputError(f"{cls.title} is malformed: it lacks {', '.join(absent)}")
        found: Self = parsed(cls, message, cls.title)
        return found


@dataclass(frozen=True)
class Hello:
    """Name, role and state rate that a listener sends when it connects.

    Attributes
    ----------
    name
        Name for people, at most 64 characters; may be empty.
    operates
        Whether it connects as an operator, which may ask for control and needs a token for that.
    states_hz
        Most states of the hand that it wants in a second, or None for all.
    """

    name: str = ""
    operates: bool = False
    states_hz: float | None = None

    def as_auth(self) -> dict[str, Any]:
        """Return the ``auth`` of the connection, without tokens."""
        role = "operator" if self.operates else "listener"
        return {
            "sharing": SHARING_VERSION,
            "role": role,
            "name": self.name,
            "states_hz": self.states_hz,
        }

    @classmethod
    def from_auth(cls, auth: object) -> Self:
        """Parse the ``auth`` of a connecting listener, which is not trusted.

        Raises
        ------
        InputError
            It is malformed or of another version; the message is for the listener's user.
        """
        role = auth.get("role") if isinstance(auth, dict) else None
        if not isinstance(auth, dict) or role not in ("listener", "operator"):
            raise InputError(
                'this port is for listeners: the role must be "listener" or "operator"'
            )
        if auth.get("sharing") != SHARING_VERSION:
            raise InputError(
                f"the listener has version {printable(str(auth.get('sharing'))[:20])} of sharing, "
                f"this leader {SHARING_VERSION}: use the same release of mmt on both"
            )
        name = auth.get("name", "")
        text = printable(name[:LONGEST_NAME]) if isinstance(name, str) else ""
        states_hz = auth.get("states_hz")
        if states_hz is not None and not (
            isinstance(states_hz, int | float) and 0.01 <= states_hz <= 1000.0
        ):
            raise InputError("states_hz must be absent, or a number from 0.01 to 1000")
        return cls(text, role == "operator", states_hz)


@dataclass(frozen=True)
class ModelDescription(PeerMessage):
    """Description of a state of the model, sent with its arrays.

    Attributes
    ----------
    session_id
        The leader's session.
    time_s
        Session time of its newest frame.
    ready
        Whether the model is good enough to render from.
    surface
        Number of the surface, or None if surfaces are not told apart.
    samples
        Number of its samples.
    completion
        The readiness of the leader's verdict, in words; see `mmt.core.verdict`.
    complete
        Whether the model is final.
    number
        Number of the state, 0 before it is published.
    made_ns
        When it was published, by the leader's monotonic clock.
    """

    title = "the model's message"

    session_id: Name
    time_s: float
    ready: Flag
    surface: int | None
    samples: int
    completion: Text
    complete: Flag
    number: Annotated[int, Strict(), Ge(1)] = field(default=0, compare=False)
    made_ns: Annotated[int, Strict()] = field(default=0, compare=False)


adapter(ModelDescription)


def shared_at(sentence: str) -> str | None:
    """Return the URL in a leader's event ``shared at URL``, or None for any other event."""
    before, _, url = sentence.partition("shared at ")
    return url if url and not before else None
