"""One process and one receive interface for all drivers that use the same arm.

The process ends with the last driver. Only the robot controls the arm. When the robot connects, the
process is started anew, since a control interface of ur_rtde is unreliable after a loss.
"""

import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, InputError
from mmt_devices.universal_robots.link import ArmLink
from mmt_devices.universal_robots.messages import UrState
from mmt_devices.universal_robots.options import UrOptions
from mmt_devices.universal_robots.servo import ServoSettings


@dataclass(eq=False)
class Member:
    """One driver that uses an arm, with its settings."""

    options: UrOptions
    servo: ServoSettings | None = None
    """Settings for moving the arm; None if the driver only reads."""
    counts: Counter[str] = field(default_factory=Counter)
    """Counts of survived faults, by kind, over all connections."""


_CONNECTING: Final = threading.Lock()
"""Held while a process starts or ends, which takes long; reading does not wait for it."""
_ARMS: "Final[dict[str, SharedArm]]" = {}


def connect(member: Member) -> "SharedArm":
    """Connect a member; return its arm, which answers and, for a robot, takes commands.

    Raises
    ------
    InputError
        The options of member and other driver contradict each other.
    MmtError
        The arm does not answer, or takes no commands.
    """
    with _CONNECTING:
        arm = _ARMS.setdefault(member.options.host, SharedArm())
        try:
            arm.admit(member)
        except BaseException:
            _forget_empty(member.options.host)
            raise
        return arm


def disconnect(arm: "SharedArm", member: Member) -> None:
    """Remove a member; without a robot the arm stops, without members its process ends."""
    with _CONNECTING:
        arm.dismiss(member)
        _forget_empty(member.options.host)


def _forget_empty(host: str) -> None:
    if not _ARMS[host].members:
        del _ARMS[host]


class SharedArm:
    """A connected arm, and the drivers that use it."""

    def __init__(self) -> None:
        self.members: list[Member] = []
        self._link: ArmLink | None = None
        self._starting = False
        self._last: UrState | None = None

    def admit(self, member: Member) -> None:
        """Add a member; start the process for a robot, or if no process works."""
        others = [other for other in self.members if other is not member]
        for other in others:
            _check_agreement(member, other)
        if member.servo is not None or not self._serves():
            self._start(member)
        self.members = [*others, member]

    def _serves(self) -> bool:
        if self._link is None:
            return False
        try:
            self._link.read()
        except DeviceLost:
            return False
        return True

    def _start(self, member: Member) -> None:
        """Start the process anew; `read` returns the last state meanwhile."""
        self._starting = True
        try:
            old, self._link = self._link, None
            if old is not None:
                self._last = old.state
                old.end()
            options = member.options
            link = ArmLink(options.host, options.frequency_hz, member.servo, member.counts)
            link.start()
            self._link = link
        finally:
            self._starting = False

    def dismiss(self, member: Member) -> None:
        """Remove a member; see `disconnect`."""
        self.members = [other for other in self.members if other is not member]
        link = self._link
        if link is None:
            return
        if not self.members:
            self._link = None
            link.end()
        elif member.servo is not None:
            link.release()

    def read(self) -> UrState:
        """Return the newest state; never blocks.

        Raises
        ------
        DeviceLost
            The arm is gone; every member gets this error.
        """
        link = self._link
        if link is not None:
            return link.read()
        if self._starting and self._last is not None:
            return self._last
        raise DeviceLost("the UR arm is not connected: connect it first")

    def kept(self) -> Sequence[UrState]:
        """Return the newest states, the oldest first."""
        link = self._link
        return () if link is None else tuple(link.kept)

    def check_control(self) -> ArmLink:
        """Return the link if the arm takes commands.

        Raises
        ------
        DeviceLost
            The arm takes no commands any more.
        """
        link = self._link
        if link is None:
            raise DeviceLost("the UR arm is not connected: connect it first")
        if link.refusal is not None:
            raise DeviceLost(link.refusal)
        return link


def _check_agreement(member: Member, other: Member) -> None:
    for name in ("frequency_hz", "rotation_rad"):
        mine, theirs = getattr(member.options, name), getattr(other.options, name)
        if mine != theirs:
            raise InputError(
                f"the UR arm at {member.options.host} is robot and force sensor: one has {name} "
                f"{_shown(mine)}, the other {_shown(theirs)}; give both the same"
            )
    if member.servo is not None and other.servo is not None:
        raise InputError(
            f"the UR arm at {member.options.host} is the robot of two drivers: close one of them"
        )


def _shown(value: float | Vector) -> str:
    return f"{value:g}" if isinstance(value, float) else str(list(value))
