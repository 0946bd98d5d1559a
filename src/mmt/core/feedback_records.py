"""Records that the two sides of force feedback exchange beside frames and commands.

They are sent only with the methods that need them; the layout is in
``docs/reference/wire.md``.
"""

from typing import Final

import numpy as np

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
