"""Records that the two sides of force feedback exchange beside frames and commands.

They are sent only with the methods that need them; the layout is in
``docs/reference/wire.md``.
"""

from typing import Final, Protocol

import numpy as np

from mmt.core.arrays import RecordArray

ENERGY: Final = "energy"
"""Both ways, with ``method = "passive"``: energy that entered through the sender's port."""

ENERGY_DTYPE: Final = np.dtype([("sequence", "<u4"), ("time_ns", "<i8"), ("energy_j", "<f8", (3,))])
"""Energy (J) of each axis since the sender began; it never falls."""

CONTACT: Final = "contact"
"""Follower to leader, with ``method = "model"``: samples from which the contact is estimated."""

CONTACT_DTYPE: Final = np.dtype(
    [
        ("sequence", "<u4"),
        ("time_ns", "<i8"),
        ("command_mm", "<f4", (3,)),
        ("position_mm", "<f4", (3,)),
        ("force_n", "<f4", (3,)),
    ]
)
"""A tick of the follower: the command given to the robot, the tool's position, and the force of
the surface on it."""

CONTACT_GATHERED: Final = 5
"""Contact samples in one message."""


class FeedbackSide(Protocol):
    """One side of a force-feedback method, as the link uses it."""

    @property
    def event(self) -> str | None:
        """Name of the further event between the two sides, or None if frames are enough."""

    @property
    def dtype(self) -> "np.dtype[np.void] | None":
        """Dtype of that event's records."""

    def on_records(self, records: RecordArray) -> None:
        """Handle validated records (n,) of the further event."""

    def restart(self) -> None:
        """Prepare for a new connection, perhaps of a restarted peer."""
