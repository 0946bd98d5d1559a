"""Commands to the service and judgement of its answers, a thousand times a second."""

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from mmt.core.arrays import Vector, step_towards
from mmt.core.guards import ForceGuard
from mmt.devices.reading_checks import PlausibilityCheck
from mmt_devices.inverse3.exchange import ABSENT, Inverse3State, ServiceAnswer
from mmt_devices.inverse3.messages import (
    CommandNames,
    OtherFormatError,
    force_command,
    greeting,
    kind_of,
    listed,
    parse,
    position_command,
    read_flag,
    read_place,
)

NO_FORCE: Final[Vector] = (0.0, 0.0, 0.0)

UNREADABLE: Final = "answers that cannot be read"
UNCALIBRATED: Final = "positions without calibration"

_LONGEST_FADE_NS: Final = 10_000_000
_LOST_NS: Final = 100_000_000
_LEAST_ANSWERS: Final = 20
"""A device is lost after so many implausible answers in a row, over more than `_LOST_NS`."""

STUCK: Final = (
    "a position that stays the same though it is commanded elsewhere: let go of the tip; see that "
    "it has power and, in the Haply Hub, that no emergency brake is engaged; where it obeys no "
    "command at all, try the option 'commands'"
)

_STUCK_NS: Final = 500_000_000
"""A tip that is pulled from the full `lead_limit_mm` moves at least a little within this time,
unless it is held fast or the service ignores commands."""
_LONGEST_STEP_S: Final = 0.005


class ChosenDevice(NamedTuple):
    """The one of the service's devices that was chosen."""

    device: str
    names: CommandNames
    entry: dict[str, Any]
    """Its entry in the service's first message."""


class ImplausibleAnswers(NamedTuple):
    """A run of implausible answers."""

    problem: str
    since_ns: int
    answers: int


class Inverse3Servo(ABC):
    """Control of one device, in the process that talks to the service.

    Parameters
    ----------
    found
        The device.
    stale_ms
        Time for which a command holds.
    clock
        Monotonic time (ns).
    """

    def __init__(
        self, found: ChosenDevice, stale_ms: float, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.device, self._names = found.device, found.names
        self.kind = kind_of(found.entry)
        self.clock = clock
        self.stale_ns = round(stale_ms * 1e6)
        self.command: Vector = NO_FORCE
        """Newest force (N) or position (mm), in the device's axes."""
        self.command_ns: int | None = None
        """Time of that command, or None before the first."""
        self.measured: Inverse3State | None = None
        self.implausible: ImplausibleAnswers | None = None
        self.fault = ""
        """Why this connection must end; empty while it can go on."""
        self.counts: Counter[str] = Counter()
        self.calibrated: bool | None = None
        """As the service reports, or None if it does not."""
        self.needs_calibration = False
        """Whether positions are implausible if the device is not calibrated."""
        self.powered = read_flag(found.entry, "power_supply")
        self.used_elsewhere = read_flag(found.entry, "in_use") is True
        """Whether another program had the device when this one connected."""
        self._watch = PlausibilityCheck()
        self._judge(found.entry, clock())

    def first_message(self) -> str:
        """Return the first message to the service."""
        return greeting(self.device, self._names)

    def release(self) -> str:
        """Return the message that takes the force away."""
        return force_command(self.device, self._names, NO_FORCE)

    @abstractmethod
    def next_message(self, now_ns: int) -> str:
        """Return the next message to the service."""

    def handle_answer(self, text: str) -> None:
        """Judge an answer of the service."""
        try:
            entry = listed(parse(text)).get(self.device)
        except (ValueError, OtherFormatError):
            self._distrust(UNREADABLE, self.clock())
            return
        if entry is None:
            self._distrust(ABSENT, self.clock())
        else:
            self._judge(entry, self.clock())

    def problem(self) -> str:
        """Return why the device is lost, to follow "it has given"; empty while it works."""
        senseless = self.implausible
        if self.fault or senseless is None or senseless.answers < _LEAST_ANSWERS:
            return self.fault
        if self.clock() - senseless.since_ns <= _LOST_NS:
            return ""
        if senseless.problem == ABSENT:
            return ABSENT
        return (
            f"{senseless.problem} for 100 ms or more, so that there is no force: check its cable "
            "and calibration, and what the Haply Hub shows of it"
        )

    def state(self) -> ServiceAnswer:
        """Return the state for the driver."""
        return ServiceAnswer(self.measured, self.calibrated, self.powered, self.used_elsewhere)

    def _judge(self, entry: Any, now_ns: int) -> None:
        calibrated, powered = read_flag(entry, "calibrated"), read_flag(entry, "power_supply")
        self.calibrated = self.calibrated if calibrated is None else calibrated
        self.powered = self.powered if powered is None else powered
        try:
            position, velocity = read_place(entry)
        except ValueError:
            self._distrust(UNREADABLE, now_ns)
            return
        problem = self._watch.problem(position, velocity, now_ns)
        if problem is None and self.needs_calibration and self.calibrated is False:
            problem = UNCALIBRATED
        if problem is not None:
            self._distrust(problem, now_ns)
            return
        self.implausible = None
        self.measured = Inverse3State(position, velocity, now_ns)

    def _distrust(self, problem: str, now_ns: int) -> None:
        """Note an implausible answer; `next_message` gives no force until a plausible one comes."""
        self.counts[problem] += 1
        before = self.implausible
        since_ns, answers = (now_ns, 0) if before is None else (before.since_ns, before.answers)
        self.implausible = ImplausibleAnswers(problem, since_ns, answers + 1)


class ForceServo(Inverse3Servo):
    """Displays a force, for the handle; it fades out while commands are stale.

    Parameters
    ----------
    found, stale_ms, clock
        See `Inverse3Servo`.
    ramp_ms
        The force fades to zero within this time once commands are stale, and comes back as slowly.
    limit_n
        Largest force, along any direction.
    """

    def __init__(
        self,
        found: ChosenDevice,
        stale_ms: float,
        ramp_ms: float,
        limit_n: float,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(found, stale_ms, clock)
        self._ramp_ns = round(ramp_ms * 1e6)
        self._share = 0.0
        self._faded_ns: int | None = None
        self._guard = ForceGuard(limit_n)

    def next_message(self, now_ns: int) -> str:
        """Return the force command, scaled by the fade."""
        if self.implausible is not None:
            self._share = 0.0
            return self.release()
        passed_ns = 0 if self._faded_ns is None else now_ns - self._faded_ns
        change = min(passed_ns, _LONGEST_FADE_NS) / self._ramp_ns
        self._faded_ns = now_ns
        if self.command_ns is not None and now_ns - self.command_ns < self.stale_ns:
            self._share = min(self._share + change, 1.0)
        else:
            if self._share == 1.0:
                self.counts["stale commands"] += 1
            self._share = max(self._share - change, 0.0)
        return force_command(self.device, self._names, self._guard.step(self.command, self._share))


class Inverse3PositionServo(Inverse3Servo):
    """Moves the point at which the service holds the tip towards the target.

    The point starts at the tip, moves at a bounded speed, and is never further from the tip than
    the option `lead_limit_mm`. So the service's spring pulls no harder than over that distance,
    and neither the first command nor one after a pause throws the arm. While commands are stale,
    the arm gets no force.

    Parameters
    ----------
    found, stale_ms, clock
        See `Inverse3Servo`.
    speed_limit_mm_s, lead_limit_mm
        See `Inverse3RobotOptions`.
    """

    def __init__(
        self,
        found: ChosenDevice,
        stale_ms: float,
        speed_limit_mm_s: float,
        lead_limit_mm: float,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(found, stale_ms, clock)
        self._speed_mm_s, self._lead_mm = speed_limit_mm_s, lead_limit_mm
        self._point: Vector | None = None
        self._pulled_at: Vector | None = None
        self._pulled_ns = self._spoke_ns = 0

    def next_message(self, now_ns: int) -> str:
        """Return the command of the next position, or of zero force."""
        passed_s = min(1e-9 * (now_ns - self._spoke_ns), _LONGEST_STEP_S)
        self._spoke_ns = now_ns
        measured, command_ns = self.measured, self.command_ns
        fresh = command_ns is not None and now_ns - command_ns < self.stale_ns
        if measured is None or self.implausible is not None or self.fault or not fresh:
            if self._point is not None and not fresh:
                self.counts["stale commands"] += 1
            self._point = self._pulled_at = None
            return self.release()
        tip = measured.position_mm
        point = step_towards(self._point or tip, self.command, self._speed_mm_s * passed_s)
        self._point = step_towards(tip, point, self._lead_mm)
        if self._point != point and tip == self._pulled_at:
            if now_ns - self._pulled_ns > _STUCK_NS:
                self.fault = STUCK
        else:
            self._pulled_at, self._pulled_ns = tip, now_ns
        return position_command(self.device, self._names, self._point)
