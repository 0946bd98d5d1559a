"""Protocols of the devices: a driver implements one of them, and nothing else is required.

Every device shares one life cycle: ``connect``, ``calibrate``, then its own calls, then
``close``. Axis z is the surface's normal: position z below zero presses into the surface,
and the force of the surface on the tool has z above zero under contact. ``connect``,
``calibrate`` and ``close`` may take long, and may be called from another thread than the rest,
since a lost device is reconnected while ticks go on; no two calls run at once. No other call may
block for longer than a small part of a 1 ms tick.
"""

import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol, runtime_checkable

from mmt.core.arrays import FloatArray, Vector
from mmt.devices.leader_reports import ActuatorStatistics, InterfaceState

if TYPE_CHECKING:
    from mmt.core.quaternions import Quaternion


class Device(Protocol):
    """The life cycle that every device has.

    A driver is a class, or a function that makes the device. It takes its options in the scene as
    keywords, or as its ``OPTIONS``, see `mmt.devices.drivers.load_device`. It raises `InputError`
    if an option is not allowed or its library is not installed.
    """

    def connect(self) -> None:
        """Open the device.

        Raises
        ------
        MmtError
            The device does not answer; the message says what to check.
        """

    def calibrate(self) -> None:
        """Take biases and zero positions; the tool is free and at rest."""

    def close(self) -> None:
        """Release the device; calling it twice is harmless."""


class Robot(Device, Protocol):
    """The follower's arm, controlled in position.

    Its calls raise `DeviceLost` if it does not answer any more, or takes no commands; the message
    says why, and `connect` may be called again later.
    """

    def read(self) -> Vector:
        """Return the tip's measured position (mm)."""

    def write(self, position_mm: Vector) -> None:
        """Command the tip's position (mm); the last command holds until the next one."""


class ForceSensor(Device, Protocol):
    """A force sensor at the follower's tip; `read` raises `DeviceLost` as that of a `Robot`."""

    def read(self) -> Vector:
        """Return the force of the surface on the tool (N), the bias removed."""


class Accelerometer(Device, Protocol):
    """An accelerometer at the follower's tip."""

    def read(self) -> Vector:
        """Return the proper acceleration (m/s2), gravity included as the sensor feels it."""


class SensorReading(NamedTuple):
    """One measurement of a sensor that runs on a clock of its own."""

    time_ns: int
    """Time by the sensor's own clock, unwrapped (from its counter and nominal rate, or its time
    stamp)."""
    value: Vector
    """Value in the channel's unit."""


class SampledSensor(Device, Protocol):
    """A sensor that runs on a clock of its own, faster or slower than the session.

    It may have ``band_hz``, the highest frequency that it passes.
    """

    latency_ns: int
    """Time from the physical instant to the sensor's own stamp, as far as it is known (filters,
    averaging); read once the sensor is connected."""

    def read(self) -> Sequence[SensorReading]:
        """Return the readings received since the last call, oldest first; never blocks.

        Raises
        ------
        DeviceLost
            The device does not answer any more; `connect` may be called again later.
        MmtError
            A fault from which it cannot recover.
        """

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of tolerated faults, by kind: bad checksums, lost records, saturation."""


@runtime_checkable
class ArrivalStamping(Protocol):
    """A sensor that knows the arrival time of its readings; optional for a driver.

    A thread or a socket can stamp data on arrival; data that waits in a serial port has no stamp.
    A sensor that knows its arrival times need not be polled between the ticks.
    """

    @property
    def arrival_ns(self) -> int:
        """Arrival time of the newest reading that `read` returned (ns, host's monotonic clock)."""


@runtime_checkable
class Pacing(Protocol):
    """A device whose driver has a loop of its own at the ticks' rate; optional for a driver."""

    def await_turn(self) -> None:
        """Return soon after that loop's next turn, or after some milliseconds."""


@runtime_checkable
class PositionKeeping(Protocol):
    """A robot whose driver also keeps positions between the ticks; optional for a driver."""

    def positions(self, after_ns: int, until_ns: int) -> Sequence[tuple[int, Vector]]:
        """Return the newest positions (mm) that came between two times, oldest first.

        Each comes with its time (ns); all times are by the host's monotonic clock.
        """


@runtime_checkable
class OrientationMeasuring(Protocol):
    """A robot that measures the orientation of its tool; optional for a driver."""

    def orientation(self) -> "Quaternion":
        """Return the tool's orientation (w, x, y, z) in the scene's axes, as new as the position.

        Frames are left out while it is not finite or its norm is not 1.
        """


def fault_table(device: Device) -> dict[str, Any]:
    """Return the ``faults`` table of a summary with a driver's counts, {} if there are none.

    Counts are optional for drivers of polled sensors, robots and handles.
    """
    try:
        faults = getattr(device, "faults", None)
    except Exception as error:  # noqa: BLE001 - a driver may ask its device, which is closed
        faults = {f"counts that cannot be read ({error})": 1}
    return {"faults": dict(faults)} if faults and isinstance(faults, Mapping) else {}


@runtime_checkable
class FaultExplaining(Protocol):
    """A sensor that can report why it gives no readings; optional for a driver."""

    def explain_fault(self) -> str:
        """Return why the received data is unusable, empty if no data comes or all is well."""


def fault_explanation(device: Device) -> str:
    """Return why a device gives no readings, as far as its driver tells."""
    return device.explain_fault() if isinstance(device, FaultExplaining) else ""


@runtime_checkable
class SetupRemarks(Protocol):
    """A device that knows the doubtful settings of its own set-up; optional for a driver."""

    def remarks(self) -> Sequence[str]:
        """Return a sentence for each doubtful setting, with what to do."""


class LeaderInterface(Device, Protocol):
    """The handle that the operator holds; its calls raise `DeviceLost` as those of a `Robot`."""

    def read(self, elapsed_ticks: int) -> InterfaceState:
        """Return the state now, `elapsed_ticks` (at least 1) ticks after the last call."""

    def write(self, force_n: Vector) -> None:
        """Display a force (N) to the hand: the kinesthetic feedback."""


class VibrationActuator(Device, Protocol):
    """A vibrotactile actuator on the leader's handle."""

    def write(self, samples_m_s2: Sequence[float] | FloatArray) -> None:
        """Play samples (n,), m/s2, after those written before.

        Their rate is `USUAL_RATE_HZ`, unless the actuator is `RateFollowing`.
        """

    @property
    def statistics(self) -> ActuatorStatistics:
        """Counts and levels so far."""


USUAL_RATE_HZ: Final = 1000.0
"""Rate of an actuator's samples, unless `RateFollowing.set_rate` gives another."""


@runtime_checkable
class RateFollowing(Protocol):
    """An actuator that plays samples of other rates; optional for a driver.

    A session with another rate than `USUAL_RATE_HZ` refuses an actuator without it.
    """

    def set_rate(self, rate_hz: float) -> None:
        """Take the rate of the samples that `write` will get; called before `connect`.

        Raises
        ------
        InputError
            The actuator cannot play samples of that rate.
        """


@runtime_checkable
class VoltageActuator(VibrationActuator, Protocol):
    """An actuator that also plays voltages, so that its response can be measured."""

    @property
    def largest_v(self) -> float:
        """Largest voltage (V) that the actuator may get."""

    def write_volts(self, volts: Sequence[float] | FloatArray) -> None:
        """Play voltages (n,), V, at the samples' rate, cut to `largest_v`, otherwise unchanged."""


@runtime_checkable
class RespondingActuator(VibrationActuator, Protocol):
    """An actuator whose response is known; optional for a driver."""

    def response(self, frequencies_hz: FloatArray) -> tuple[FloatArray, float]:
        """Return the acceleration at the handle over the wanted one.

        Parameters
        ----------
        frequencies_hz
            Shape (f,).

        Returns
        -------
        gain
            Shape (f,), magnitudes.
        low_hz
            The actuator is not driven below this frequency.
        """


class VoltageReading(NamedTuple):
    """The voltages of several inputs at one instant."""

    time_ns: int
    """Time by the board's own clock, unwrapped."""
    volts: tuple[float, ...]
    """Volts in the order of the inputs that the board was asked for."""


class VoltageBoard(Protocol):
    """A board that samples inputs at a rate of its own.

    Inputs, rate and gain are options of the board's driver. A board may have ``arrival_ns`` as in
    `ArrivalStamping`, and ``serial``, a name under which the calibration of a sensor at the board
    is stored.
    """

    latency_ns: int
    """Time from the physical instant to the stamp, as far as it is known."""
    inputs: int
    """How many voltages a reading has."""
    limit_v: float
    """Largest magnitude that it measures."""

    def connect(self) -> None:
        """Open the board and begin to sample.

        Raises
        ------
        MmtError
            The board does not answer; the message says what to check.
        """

    def read(self) -> Sequence[VoltageReading]:
        """Return the readings received since the last call, oldest first; never blocks.

        Raises
        ------
        DeviceLost
            The board does not answer any more; `connect` may be called again later.
        """

    def close(self) -> None:
        """Release the board; calling it twice is harmless."""

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of tolerated faults, by kind."""


def arrival_of(board: VoltageBoard) -> int:
    """Return the arrival time of a board's newest reading: its ``arrival_ns``, else now."""
    told: int | None = getattr(board, "arrival_ns", None)
    return time.monotonic_ns() if told is None else told
