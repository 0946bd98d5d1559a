"""One device of a follower: read or write it, see that it is lost, and connect it again."""

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, Final

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.lanes import Lane, PolledLane
from mmt.devices.protocols import (
    Accelerometer,
    ArrivalStamping,
    Device,
    FaultExplaining,
    ForceSensor,
    PositionKeeping,
    Robot,
    SampledSensor,
    Vector,
    survived,
)
from mmt.devices.reconnection import Reasons, Reconnection

SILENT_NS: Final = 15_000_000
"""Time without a reading after which a sampled sensor is lost, where it is no slow one."""

_SILENT_PERIODS: Final = 3.0  # of a slow one, instead
_EMPTY_READS: Final = 8
"""Empty reads in a row that a loss takes too: a host that was held up is no lost sensor."""
_MOST_DISCARDED: Final = 64
"""Reads of what has waited, of a few kB or some hundred readings each."""
_PATIENCE_NS: Final = 250_000_000
"""Time that a silent sensor is read on before it is connected again."""
_SETTLE_NS: Final = 100_000_000
"""Time that a sensor is read after a reconnection before frames are formed of it, so that
its clock is known."""
_ROBOT_GAP_NS: Final = 10_000_000
"""Time for which an arm moves nearly on a line: at 5 m/s2 it leaves the line by 0.06 mm."""


class Slot(ABC):
    """One device in its role.

    Parameters
    ----------
    role
        What a person calls it.
    device
        The driver.
    lane
        Takes what it measures.
    """

    def __init__(self, role: str, device: Device, lane: Lane) -> None:
        self.role = role
        self.device = device
        self.lane = lane
        self.losses = 0
        """How often it was lost."""
        self.lost_ns: int | None = None
        """Since when it is lost, by the host's clock; None where it is there."""
        self._reconnection: Reconnection | None = None
        self._reason = ""  # why it is not back yet
        self._reasons = Reasons("")
        self._listening_ns = 0
        self._heard_ns: int | None = None

    def describe(self) -> str:
        """Name it."""
        return f"{self.role} {type(self.device).__name__}"

    @abstractmethod
    def step(self, now_ns: int, command_position_mm: Vector | None) -> None:
        """Do what falls due at a tick.

        Raises
        ------
        Exception
            Whatever its driver raises; `DeviceLost` where it may come back.
        """

    def lose(self, now_ns: int, reason: str) -> None:
        """Mark it as lost, for a reason that is reported already, and connect it again."""
        self._note_loss(now_ns, reason)
        self._connect()

    def _note_loss(self, now_ns: int, reason: str) -> None:
        self.losses += 1
        self.lost_ns = now_ns
        self._reason, self._reasons = "", Reasons(reason)

    def new_reason(self) -> str:
        """Return why it is not back yet, empty if unknown or reported already."""
        return self._reasons.new(self._reason)

    def reconnect(self, now_ns: int) -> bool:
        """Go on with connecting it again; return whether it is there.

        Raises
        ------
        Exception
            What its driver raises but `DeviceLost`.
        """
        if self._reconnection is not None:
            if not self._reconnection.done.is_set():
                self._reason = self._reconnection.reason or self._reason
                return False
            self._reconnection = None
            self._listen(now_ns)
        try:
            there = self._answers(now_ns)
        except DeviceLost as error:
            self._reason = str(error)
            self._connect()
            return False
        if there:
            self.lost_ns = None
        return there

    def close(self) -> None:
        """Close the device."""
        if self._reconnection is not None:
            self._reconnection.give_up()
        self.device.close()

    @property
    def summary(self) -> dict[str, Any]:
        """What it gave and what its driver survived, for a program."""
        name = type(self.device).__name__
        return {"device": name, "losses": self.losses, **survived(self.device)}

    def _connect(self) -> None:
        self._reconnection = Reconnection(self.device)

    def _listen(self, now_ns: int) -> None:
        self._listening_ns, self._heard_ns = now_ns, None

    def _answers(self, now_ns: int) -> bool:
        self.step(now_ns, None)
        return True


class RobotSlot(Slot):
    """The robot: commanded, then read where the scene needs its position.

    Where ticks were held up and its driver has kept positions meanwhile, those are taken too.
    """

    device: Robot
    lane: PolledLane

    def __init__(self, role: str, device: Robot, *, measures: bool) -> None:
        super().__init__(role, device, PolledLane(_ROBOT_GAP_NS))
        self._measures = measures
        self._keeping = device if isinstance(device, PositionKeeping) else None
        self._last_ns = 0

    def step(self, now_ns: int, command_position_mm: Vector | None) -> None:
        """Command it, then read it."""
        if command_position_mm is not None:
            self.device.write(command_position_mm)
        if self._measures:
            position = self.device.read()
            if self._keeping is not None and now_ns - self._last_ns > _ROBOT_GAP_NS // 2:
                for time_ns, kept in self._keeping.positions(self._last_ns, now_ns):
                    self.lane.record(kept, time_ns)
            self.lane.record(position, now_ns)
            self._last_ns = now_ns


class PolledSlot(Slot):
    """A sensor that says what it measures when it is asked."""

    device: ForceSensor | Accelerometer
    lane: PolledLane

    def __init__(self, role: str, device: ForceSensor | Accelerometer) -> None:
        super().__init__(role, device, PolledLane())

    def step(self, now_ns: int, command_position_mm: Vector | None) -> None:  # noqa: ARG002
        """Read it."""
        self.lane.record(self.device.read(), now_ns)


class SampledSlot(Slot):
    """A sensor that runs on a clock of its own."""

    device: SampledSensor

    def __init__(self, role: str, device: SampledSensor, lane: Lane | None = None) -> None:
        super().__init__(role, device, Lane() if lane is None else lane)
        self.lane.latency_ns = device.latency_ns
        self._stamping = device if isinstance(device, ArrivalStamping) else None
        self._last_ns = 0
        self._empty = 0
        self._begun = self._settles = False

    @property
    def knows_arrivals(self) -> bool:
        """Whether it need not be looked at to know when a reading has come."""
        return self._stamping is not None

    def begin(self, now_ns: int) -> None:
        """Begin to wait for readings."""
        self._last_ns, self._empty = now_ns, 0

    def step(self, now_ns: int, command_position_mm: Vector | None) -> None:  # noqa: ARG002
        """Take what has come.

        Raises
        ------
        DeviceLost
            Nothing has come for too long.
        """
        if self.poll():
            self._last_ns, self._empty = now_ns, 0
            return
        self._empty += 1
        silent_ns = now_ns - self._last_ns
        if self._empty >= _EMPTY_READS and silent_ns >= self._silence_ns(SILENT_NS):
            complaint = self.device.complaint() if isinstance(self.device, FaultExplaining) else ""
            raise DeviceLost(
                complaint
                or f"no reading for {silent_ns / 1e6:.0f} ms; check its cable, its power, "
                "and whether this machine has time for it"
            )

    def _silence_ns(self, least_ns: int) -> float:
        return max(least_ns, _SILENT_PERIODS * self.lane.period_ns)

    def poll(self) -> bool:
        """Take what has come; return whether anything has.

        The first time, what has waited since it was connected is left out: its clock would seem
        behind by as much, and then to jump.
        """
        if not self._begun:
            self._begun = True
            for _ in range(_MOST_DISCARDED):
                if not self.device.read():
                    break
        readings = self.device.read()
        if readings:  # a time from before the call might be before they came
            stamping = self._stamping
            self.lane.add(
                readings, time.monotonic_ns() if stamping is None else stamping.arrival_ns
            )
        return bool(readings)

    def lose(self, now_ns: int, reason: str) -> None:
        """Listen for a while where it was merely silent, then connect it again."""
        self._note_loss(now_ns, reason)
        self._settles = False
        self._listen(now_ns)

    def _connect(self) -> None:
        self._begun, self._settles = False, True
        self.lane.reset()
        super()._connect()

    def _answers(self, now_ns: int) -> bool:
        if self.poll():
            self._last_ns, self._empty = now_ns, 0
            if self._heard_ns is None:
                self._heard_ns = now_ns
            return not self._settles or now_ns - self._heard_ns >= _SETTLE_NS
        since_ns = self._listening_ns if self._heard_ns is None else self._last_ns
        if now_ns - since_ns >= self._silence_ns(_PATIENCE_NS):
            raise DeviceLost("")  # which is no news
        return False

    @property
    def summary(self) -> dict[str, Any]:
        """What it gave and what its driver survived, for a program."""
        return {
            **super().summary,
            "readings": self.lane.readings,
            "drift_ppm": round(1e6 * self.lane.clock.drift, 1),
            "clock_jumps": self.lane.clock.jumps,
            "faults": dict(self.device.faults),
        }


def slot_of(role: str, device: Any, lane: Lane | None = None) -> Slot:
    """Return a sensor's slot: one that says its latency runs on a clock of its own.

    `lane` makes its values, where the usual one would lose what is fast.
    """
    if hasattr(device, "latency_ns"):
        return SampledSlot(role, device, lane)
    return PolledSlot(role, device)


def failure(slot: Slot, error: Exception) -> MmtError:
    """Return the message for any exception that a driver raises."""
    reason = str(error) or type(error).__name__
    return MmtError(f"the {slot.role} ({type(slot.device).__name__}) failed: {reason}")


def summaries(slots: Mapping[str, Slot]) -> dict[str, Any]:
    """Return every slot's summary by its key."""
    return {key: slot.summary for key, slot in slots.items()}
