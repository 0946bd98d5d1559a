"""Messages from whoever shares a model to its listeners; ``docs/reference/sharing.md``.

All are Socket.IO events of the link's namespace and serializer. A model has a number, which grows
by one with each of its changes. A listener gets the whole of it first, and then what has changed
since the number that it has; where it lacks one in between it gets the whole again.
"""

from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np

from mmt.core.errors import InputError
from mmt.core.printable import printable
from mmt.link.protocol import encode_event

SHARING_VERSION: Final = 1

TOKEN_VARIABLE: Final = "MMT_SHARING_TOKEN"  # noqa: S105 - the variable's name

WELCOME: Final = "welcome"
"""To a listener, as each session begins: ``{"sharing": int, "session_id": str, "name": str,
"rate_hz": int}``."""
MODEL: Final = "model"
"""To a listener: the model as it is, a map of ``number``, `About`, and ``file``, a model file."""
CHANGE: Final = "change"
"""To a listener: a map of ``number``, ``since``, `About`, and `mmt_share.difference`."""
STATE: Final = "state"
"""To a listener, 20 times a second or as often as it wants: where the tool is, `STATE_DTYPE`."""
END: Final = "end"
"""To a listener: ``{"outcome": str}``; the session is over."""
AGAIN: Final = "again"
"""From a listener, after `WELCOME` and wherever it lacks a change: send the whole model."""

HAVE: Final = "have"
"""From a listener, to the first eight states and then to one a second: `mmt_share.lag.Have`."""
HUBS: Final = "hubs"
"""From a hub to a listener: a list of the other hubs' addresses, whenever it has changed. The same
list is in `WELCOME`, as ``hubs``."""
MOST_HUBS: Final = 64
"""Most addresses that a listener keeps."""

LONGEST_ADDRESS: Final = 256

LONGEST_NAME: Final = 64
LONGEST_MESSAGE: Final = 4 << 20
"""Most bytes of a message to a listener; a model of a thousand samples has some 200,000."""

PING_S: Final = 5, 5
"""Seconds between two pings of a listener, and how long it may take to answer. Each takes the
library as long as ten states take; a connection that is closed is known at once."""

STATE_DTYPE: Final = np.dtype(
    [
        ("time_s", "<f8"),
        ("position_mm", "<f4", 3),
        ("velocity_mm_s", "<f4", 3),
        ("force_n", "<f4"),
        ("contact", "u1"),
    ]
)
"""The hand that strokes, 37 bytes: session time, position, velocity, normal force, contact."""


@dataclass(frozen=True)
class Hello:
    """What a listener says of itself as it connects.

    Attributes
    ----------
    name
        What a person calls it, at most 64 characters; may be empty.
    operates
        Whether it may ask for control, and so has shown the token for that.
    states_hz
        How many states of the hand it wants in a second at most, None for all.
    """

    name: str = ""
    operates: bool = False
    states_hz: float | None = None

    def as_auth(self) -> dict[str, Any]:
        """Return the ``auth`` of its connection, without a token."""
        role = "operator" if self.operates else "listener"
        return {
            "sharing": SHARING_VERSION,
            "role": role,
            "name": self.name,
            "states_hz": self.states_hz,
        }

    @classmethod
    def from_auth(cls, auth: object) -> Self:
        """Return what a connecting listener says, which is not trusted.

        Raises
        ------
        InputError
            It is none of this version; the message is for its user.
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
class About:
    """What is said of a model beside its arrays.

    Attributes
    ----------
    session_id
        Of the session that it is of.
    time_s
        Session time of its newest frame.
    ready
        Whether it is good enough to render from.
    surface
        Number of the surface that it is of, None where surfaces are not told apart.
    samples
        Number of its samples.
    completion
        What the criterion says of it, in words.
    complete
        Whether it will grow no more.
    """

    session_id: str
    time_s: float
    ready: bool
    surface: int | None
    samples: int
    completion: str
    complete: bool

    def as_dict(self) -> dict[str, Any]:
        """Return it as a map for the wire."""
        return dict(vars(self))

    @classmethod
    def from_message(cls, message: Any) -> Self:
        """Return what a message says, which is not trusted.

        Raises
        ------
        InputError
            It is malformed.
        """
        try:
            surface = message["surface"]
            return cls(
                session_id=printable(str(message["session_id"])[:LONGEST_NAME]),
                time_s=float(message["time_s"]),
                ready=message["ready"] is True,
                surface=None if surface is None else int(surface),
                samples=int(message["samples"]),
                completion=printable(str(message["completion"])[:256]),
                complete=message["complete"] is True,
            )
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise InputError(f"the model's message is malformed: {error}") from error


def model_message(number: int, made_ns: int, about: About, file: bytes) -> dict[str, Any]:
    """Return the argument of `MODEL`, for a model made at this time of the leader's clock."""
    return {"number": number, "made_ns": made_ns, **about.as_dict(), "file": file}


def encode_change(number: int, made_ns: int, about: About, change: dict[str, Any]) -> bytes:
    """Return the message that leads from a model's last number to this one."""
    head = {"number": number, "since": number - 1, "made_ns": made_ns}
    return encode_event(CHANGE, {**head, **about.as_dict(), **change})


def shared_at(sentence: str) -> str | None:
    """Return where a leader's event says that its model is shared, None for any other event."""
    before, _, url = sentence.partition("shared at ")
    return url if url and not before else None
