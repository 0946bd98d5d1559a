"""The part that reads the operator's hand, real or simulated, and commands the follower."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final, Protocol

from mmt.core.arrays import RecordArray, Vector
from mmt.leader.part import Part, Session, Tick

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.devices.protocols import LeaderInterface
    from mmt.devices.reconnection import OperatorHandle
    from mmt.leader.motion.hand_contact import FollowerContact


_NO_OFFSET: Final[Vector] = (0.0, 0.0, 0.0)


class CommandSource(Protocol):
    """Decides on the robot's command if other hands may move the robot too."""

    @property
    def overridden(self) -> bool:
        """Whether this hand may not move the robot now."""

    def command(self, tick: Tick, own_mm: Vector | None) -> Vector | None:
        """Return the command (mm), given this hand's own command; or None."""


class HandPart(Part):
    """Read the hand once a tick, and ask the follower to take its position.

    Parameters
    ----------
    session
        Session of the run.
    device
        The hand.
    handle
        The same device, if it is a driver's handle that may be lost and come back.
    contact
        Estimates contact and force, if the handle measures none.
    """

    def __init__(
        self,
        session: Session,
        device: "LeaderInterface | OperatorHandle",
        handle: "OperatorHandle | None" = None,
        contact: "FollowerContact | None" = None,
    ) -> None:
        self._session = session
        self.device = device
        self.handle = handle
        self.contact = contact
        self._not_finite = 0  # those of a handle that may be lost are counted there
        self.control: CommandSource | None = None
        """Decides on the command; None if this hand alone does."""
        self.command_mm: Vector | None = None
        """The last command sent to the follower (mm), or None before the first."""
        if handle is not None:
            handle.watch(session.journal.event)

    @property
    def name(self) -> str:
        """The device's name."""
        return self.handle.name if self.handle is not None else type(self.device).__name__

    def connect(self) -> None:
        """Open the device and calibrate it."""
        self.device.connect()
        self.device.calibrate()

    def close(self) -> None:
        """Release the device."""
        self.device.close()

    def on_frames(self, frames: RecordArray, _arrival_ns: int) -> None:
        """Pass frames (n,) to the contact."""
        if self.contact is not None:
            self.contact.on_frames(frames)

    def tick(self, tick: Tick) -> None:
        """Read the hand and command the follower, while a follower is connected."""
        tick.state = tick.operating = None
        tick.overridden = self.control is not None and self.control.overridden
        tick.offset_mm = _NO_OFFSET
        handle, remote = self.handle, self._session.remote
        if tick.streaming:
            state = self.device.read(tick.elapsed)
            if handle is None and state is not None and not state.is_finite:
                self._not_finite += 1
                state = None
            tick.state = state
            if handle is not None:
                position = handle.command_mm
            else:
                position = state.position_mm if state is not None else None
            if self.control is not None:
                position = self.control.command(tick, position)
            if remote is not None and position is not None:
                remote.command(tick.now_ns, position)
                self.command_mm = position
            if self.contact is not None and state is not None:
                place_mm = state.position_mm if position is None else position
                tick.state = self.contact.state_of(state, place_mm)
        tick.hand_lost = handle is not None and handle.lost

    def faults(self) -> list[str]:
        """Return why the handle is lost."""
        return [self.handle.problem] if self.handle is not None and self.handle.problem else []

    def summary(self, _duration_s: float) -> dict[str, Any]:
        """Return how often and how long a handle was lost, and the faults its driver survived."""
        device: Any = self.device
        found: dict[str, Any] = {}
        if self.handle is not None:
            device, found = self.handle.device, self.handle.losses_summary
        not_finite = self._not_finite if self.handle is None else self.handle.not_finite
        found = found | ({"not_finite": not_finite} if not_finite else {})
        if hasattr(device, "faults"):
            from mmt.devices.protocols import fault_table

            found = found | fault_table(device)
        if self.contact is not None and self.contact.summary:
            found = {**found, "contact": self.contact.summary}
        return {"handle": {"device": self.name, **found}} if found else {}

    def metrics(self) -> "Iterable[Metric]":
        """Return losses of a handle."""
        return loss_metrics(self.handle)


def loss_metrics(device: Any) -> "Iterable[Metric]":
    """Return whether a reconnecting device is lost, and how often it was; nothing for None."""
    if device is None:
        return
    from mmt.core.output.exposition import counter, gauge

    yield gauge(f"{device.what}_lost", f"Whether the {device.what} is lost.", device.lost)
    yield counter(f"{device.what}_losses", f"Losses of the {device.what}.", device.losses)
