"""One device of a follower: read or write it, detect its loss, and reconnect it."""

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.core.output.logs import RepeatLimit
from mmt.devices.protocols import (
    Accelerometer,
    ArrivalStamping,
    Device,
    ForceSensor,
    OrientationMeasuring,
    PositionKeeping,
    Robot,
    SampledSensor,
    fault_explanation,
    fault_table,
)
from mmt.devices.reading_checks import LOG, QUIET_S
from mmt.devices.reconnection import Reasons, Reconnection
from mmt.devices.streaming.lanes import Lane, OrientationLane, PolledLane

SILENT_NS: Final = 15_000_000
"""Time without a reading after which a sampled sensor is lost, unless it is a slow one."""

_SILENT_PERIODS: Final = 3.0  # for a slow sensor, instead
_EMPTY_READS: Final = 8
"""Empty reads in a row that a loss needs too: a held-up host does not mean a lost sensor."""
_MOST_DISCARDED: Final = 64
"""Reads that discard old readings at most, of a few kB or some hundred readings each."""
_PATIENCE_NS: Final = 250_000_000
"""Time for which a silent sensor is still read before it is reconnected."""
_SETTLE_NS: Final = 100_000_000
"""Time for which a reconnected sensor is read before its readings make frames, so that
its clock is known."""
_ROBOT_GAP_NS: Final = 10_000_000
"""Longest interpolated gap of an arm's positions: at 5 m/s2 it leaves the line by 0.06 mm."""


class Slot(ABC):
    """One device in its role.

    Parameters
    ----------
    role
        Name of the role in messages.
    device
        The driver.
    lane
        Takes the device's readings.
    """

    def __init__(self, role: str, device: Device, lane: Lane) -> None:
        self.role = role
        self.name = f"the {role} ({type(device).__name__})"
        self.device = device
        self.lane = lane
        self._invalid = RepeatLimit(QUIET_S)
        lane.on_invalid = self._warn
        self._lanes = {"invalid_readings": lane}
        self.losses = 0
        """How often it was lost."""
        self.lost_ns: int | None = None
        """Time of the loss by the host's clock, or None if the device is not lost."""
        self._reconnection: Reconnection | None = None
        self._earlier: Reconnection | None = None
        self._reason = ""  # why it is not back yet
        self._reasons = Reasons("")
        self._listening_ns = 0
        self._heard_ns: int | None = None

    def describe(self) -> str:
        """Return the role and the driver's class."""
        return f"{self.role} {type(self.device).__name__}"

    @abstractmethod
    def step(self, now_ns: int, command_position_mm: Vector | None) -> None:
        """Command or read the device at a tick.

        Raises
        ------
        Exception
            Any exception of its driver; `DeviceLost` if the device may come back.
        """

    def lose(self, now_ns: int, reason: str) -> None:
        """Mark the device as lost, for a reason that is reported already, and reconnect it."""
        self._note_loss(now_ns, reason)
        self._connect()

    def _note_loss(self, now_ns: int, reason: str) -> None:
        self.losses += 1
        self.lost_ns = now_ns
        self._reason, self._reasons = "", Reasons(reason)

    def new_reason(self) -> str:
        """Return why the device is not back yet, empty if unknown or reported already."""
        return self._reasons.new(self._reason)

    def reconnect(self, now_ns: int) -> bool:
        """Continue the reconnection, whatever its driver raises; return whether it is back."""
        if self._reconnection is not None:
            if not self._reconnection.done.is_set():
                self._reason = self._reconnection.reason or self._reason
                return False
            self._earlier, self._reconnection = self._reconnection, None
            self._listen(now_ns)
        try:
            there = self._answers(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may have let go of the device
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
        """Counts of the device and faults that its driver tolerated, for a program."""
        found = {
            "device": type(self.device).__name__,
            "losses": self.losses,
            "missed_frames": max(lane.missed_frames for lane in self._lanes.values()),
        }
        faults = {kind: lane.invalid for kind, lane in self._lanes.items() if lane.invalid}
        told = fault_table(self.device).get("faults", {})
        return {**found, "faults": told | faults} if told or faults else found

    def _warn(self) -> None:
        self._invalid.warn(
            LOG,
            f"{self.name} gives readings that are not finite, too large, or at the time of the one "
            "before: they are left out, and the summary has their number; check its calibration, "
            "range, clock and wires",
        )

    def _connect(self) -> None:
        self._reconnection = Reconnection(self.device, before=self._earlier)

    def _listen(self, now_ns: int) -> None:
        self._listening_ns, self._heard_ns = now_ns, None

    def _answers(self, now_ns: int) -> bool:
        self.step(now_ns, None)
        return True


class RobotSlot(Slot):
    """The robot: commanded, then read if the scene needs its position.

    If ticks were held up and its driver has kept positions meanwhile, those are taken too.

    Parameters
    ----------
    role, device
        See `Slot`.
    measures, turns
        Whether the scene needs its position, and its tool's orientation.

    Raises
    ------
    InputError
        The driver does not measure the orientation; the message names those that do.
    """

    device: Robot
    lane: PolledLane

    def __init__(self, role: str, device: Robot, *, measures: bool, turns: bool = False) -> None:
        super().__init__(role, device, PolledLane(_ROBOT_GAP_NS))
        self._measures = measures
        self.orientation = OrientationLane()
        self.orientation.on_invalid = self._warn
        self._lanes["invalid_orientations"] = self.orientation
        self._turning = _turning(device) if turns else None
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
        if self._turning is not None:
            self.orientation.record(self._turning.orientation(), now_ns)


class PolledSlot(Slot):
    """A sensor without a clock, read at each tick."""

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
        self.stamping = device if isinstance(device, ArrivalStamping) else None
        self._last_ns = 0
        self._empty = 0
        self._begun = self._settles = False

    def begin(self, now_ns: int) -> None:
        """Begin to wait for readings."""
        self._last_ns, self._empty = now_ns, 0

    def step(self, now_ns: int, command_position_mm: Vector | None) -> None:  # noqa: ARG002
        """Take the new readings.

        Raises
        ------
        DeviceLost
            No reading has come for too long.
        """
        if self.poll():
            self._last_ns, self._empty = now_ns, 0
            return
        self._empty += 1
        silent_ns = now_ns - self._last_ns
        if self._empty >= _EMPTY_READS and silent_ns >= self._silence_ns(SILENT_NS):
            raise DeviceLost(
                fault_explanation(self.device)
                or f"no reading for {silent_ns / 1e6:.0f} ms; check its cable, its power, "
                "and whether this machine has time for it"
            )

    def _silence_ns(self, least_ns: int) -> float:
        return max(least_ns, _SILENT_PERIODS * self.lane.period_ns)

    def poll(self) -> bool:
        """Take the new readings; return whether any is valid.

        The first call discards the readings that have waited since `connect`: with them the
        sensor's clock would seem behind, and then to jump.
        """
        if not self._begun:
            self._begun = True
            for _ in range(_MOST_DISCARDED):
                if not self.device.read():
                    break
        readings = self.device.read() or ()  # a stranger's driver may return None for nothing
        stamping = self.stamping  # a time taken before the call might precede their arrival
        return self.lane.add(
            readings, time.monotonic_ns() if stamping is None else stamping.arrival_ns
        )

    def lose(self, now_ns: int, reason: str) -> None:
        """Mark the sensor as lost; listen for a while before it is reconnected."""
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
            raise DeviceLost("")  # no new reason
        return False

    @property
    def summary(self) -> dict[str, Any]:
        """Counts of the device and faults that its driver tolerated, for a program."""
        return {
            "faults": {},
            **super().summary,
            "readings": self.lane.readings,
            "drift_ppm": round(1e6 * self.lane.clock.drift, 1),
            "clock_jumps": self.lane.clock.jumps,
        }


def _turning(device: Robot) -> OrientationMeasuring:
    """Return a robot as one that measures its tool's orientation, or raise `InputError`."""
    if isinstance(device, OrientationMeasuring):
        return device
    from mmt.devices.discovery import drivers_with

    raise InputError(
        f"[session] orientation: {type(device).__name__} does not measure the orientation of its "
        f"tool; robots that do are {', '.join(drivers_with('robot', 'orientation'))}"
    )


def slot_of(role: str, device: Any, lane: Lane | None = None) -> Slot:
    """Return a sensor's slot; a sensor with ``latency_ns`` runs on a clock of its own.

    `lane` takes its readings if the usual lane would lose high frequencies.
    """
    if hasattr(device, "latency_ns"):
        return SampledSlot(role, device, lane)
    return PolledSlot(role, device)


def failure(slot: Slot, error: Exception) -> MmtError:
    """Return the message for any exception that a driver raises."""
    reason = str(error) or type(error).__name__
    return MmtError(f"{slot.name} failed: {reason}")


@contextmanager
def named(slot: Slot) -> Iterator[None]:
    """Raise an exception of the slot's driver as an `MmtError` that names the device."""
    try:
        yield
    except Exception as error:
        raise failure(slot, error) from error
