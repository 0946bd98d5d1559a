"""Messages to ask for, give and use control of a robot; ``docs/reference/sharing.md``.

A leader with ``[control]`` exchanges them with operators: listeners that have its control token.
"""

from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from pydantic import AfterValidator, Field, Strict

from mmt.contact.estimation import ContactModel
from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.link.access import Access
from mmt.link.protocol import encode_event
from mmt.scene.table import SecuredTable
from mmt_share.messages import HAND_FIELDS, PeerMessage, Text, adapter
from mmt_share.tables import CONTROL_VARIABLE

ASK: Final = "ask"
"""From an operator: request for control. No argument."""
RELEASE: Final = "release"
"""From an operator: withdraws its request, or gives control back. No argument."""
MOTION: Final = "motion"
"""From an operator that has control: number of its grant (u4), then records of `MOTION_DTYPE`."""
CONTROL: Final = "control"
"""To an operator: state of its control, `ControlNews`."""
CONTACT: Final = "contact"
"""To the operator that has control, 20 times a second: `SharedContact`."""

MOST_RECORDS: Final = 100
"""Most records in one message of motion."""
MOTION_HZ: Final = 30.0
"""Rate limit of an operator, beside that of a listener: 300 messages and 600 kB a second."""
FARTHEST_MM: Final = 10_000.0
"""Largest coordinate that a hand's position may have."""
_LARGEST: Final = {"position_mm": FARTHEST_MM, "velocity_mm_s": 100_000.0, "force_n": 1000.0}
_GRANT: Final = np.dtype("<u4")

MOTION_DTYPE: Final = np.dtype([("time_ns", "<i8"), *HAND_FIELDS])
"""State of a hand at a time of its own monotonic clock, 37 bytes: wanted position of the robot,
velocity and normal force of the hand, and whether it presses."""


def control_access(token_file: Path | None) -> Access:
    """Return the access with the control token, from `CONTROL_VARIABLE` or from its file.

    Raises
    ------
    InputError
        There is no such token, it is too short, or its file cannot be read.
    """
    access = Access.from_settings(SecuredTable(token_file=token_file), variable=CONTROL_VARIABLE)
    if access.token is None:
        raise InputError(
            "control of a robot needs a token of its own: set one by "
            f"{CONTROL_VARIABLE}=$(openssl rand -hex 32), or by token_file of [control] at the "
            "leader and of [operating] at the listener"
        )
    return access


_Place = Annotated[float, Strict(), Ge(-FARTHEST_MM), Le(FARTHEST_MM)]


@dataclass(frozen=True)
class ControlNews(PeerMessage):
    """State of an operator's control.

    Attributes
    ----------
    state
        The request was received or refused, or control was given or has ended.
    grant
        Number of the grant, 0 before the first; each grant of a session has its own number.
    hold_mm
        Where the robot holds; the operator's first position must be there.
    recovery_mm_s
        Speed at which the difference between robot and hand may shrink.
    why
        Reason as a sentence, may be empty.
    """

    title = "a message about control"

    state: Annotated[str, Field(pattern="^(asked|refused|given|ended)$")]
    grant: Annotated[int, Strict(), Ge(0), Lt(2**32)] = 0
    hold_mm: tuple[_Place, _Place, _Place] = (0.0, 0.0, 0.0)
    recovery_mm_s: Annotated[float, Strict(), Gt(0), Le(1000)] = 50.0
    why: Text = ""

    def encode(self) -> bytes:
        """Return the message."""
        return encode_event(CONTROL, {**vars(self), "hold_mm": list(self.hold_mm)})


_ACCEPTED: Final = {
    "surface_m": (-10.0, 10.0),
    "stiffness_n_m": (1e-9, 1e12),
    "exponent": (0.5, 3.0),
    "damping_n_s_m": (0.0, 1e4),
    "dissipation_s_m": (0.0, 100.0),
}
"""Parameters of a contact's model, with the range that is accepted."""


def _accepted(model: ContactModel) -> ContactModel:
    for name, (low, high) in _ACCEPTED.items():
        if not low <= getattr(model, name) <= high:
            raise ValueError(f"{name} is out of range")
    return model


@dataclass(frozen=True)
class SharedContact(PeerMessage):
    """The contact from which an operator's force is rendered.

    Attributes
    ----------
    model
        Model along the normal, in the robot's coordinates, or None if it is not known.
    normal
        Index of the normal axis.
    limit_n
        Largest force that the leader shows to its own hand.
    """

    title = "a message about the contact"

    model: Annotated[ContactModel, AfterValidator(_accepted)] | None
    normal: Annotated[int, Strict(), Ge(0), Le(2)]
    limit_n: Annotated[float, Strict(), Ge(0), Le(40)]

    def encode(self) -> bytes:
        """Return the message."""
        return encode_event(CONTACT, asdict(self))


for _kind in (ControlNews, SharedContact):
    adapter(_kind)


def encode_motion(grant: int, records: RecordArray) -> bytes:
    """Return the message of an operator's motion, records (n,) of `MOTION_DTYPE`."""
    return encode_event(MOTION, _GRANT.type(grant).tobytes() + records.tobytes())


def decode_motion(data: bytes) -> tuple[int, RecordArray]:
    """Parse untrusted motion; return the number of the grant and the records (n,), n >= 1.

    Raises
    ------
    InputError
        The number of records, their times or a value is not possible.
    """
    count, rest = divmod(len(data) - _GRANT.itemsize, MOTION_DTYPE.itemsize)
    if rest or not 1 <= count <= MOST_RECORDS:
        raise InputError(f"an operator's motion has 1 to {MOST_RECORDS} whole records")
    grant = int(np.frombuffer(data, _GRANT, 1)[0])
    records: RecordArray = np.frombuffer(data, MOTION_DTYPE, offset=_GRANT.itemsize)
    times = records["time_ns"].tolist()
    if times[0] < 0 or any(b <= a for a, b in pairwise(times)):
        raise InputError("the times of an operator's motion grow")
    within = all(
        bool((np.abs(records[name]) <= most).all())  # False for NaN
        for name, most in _LARGEST.items()
    )
    if not within:
        raise InputError("an operator's motion is out of range")
    return grant, records
