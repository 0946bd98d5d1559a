"""What goes to and from the service a thousand times a second: a command out, a state in."""

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from typing import Any, Final, NamedTuple, TypeVar

from mmt.devices.haply.messages import (
    CommandNames,
    OtherFormatError,
    force_command,
    greeting,
    kind_of,
    listed,
    parse,
    read_flag,
    read_place,
)
from mmt.devices.plausibility import Watch
from mmt.devices.protocols import Vector

NO_FORCE: Final[Vector] = (0.0, 0.0, 0.0)

ABSENT: Final = "answers without the device"
UNREADABLE: Final = "answers that cannot be read"
UNCALIBRATED: Final = "positions without calibration"

_LONGEST_STEP_NS: Final = 10_000_000


class Found(NamedTuple):
    """The device that was chosen of those of the service."""

    device: str
    names: CommandNames
    entry: dict[str, Any]
    """What the first message says of it."""


class Measured(NamedTuple):
    """One state of the device that makes sense, in its own axes."""

    position_mm: Vector
    velocity_mm_s: Vector
    time_ns: int
    """When it came, by the host's monotonic clock."""


class Senseless(NamedTuple):
    """A row of answers that make no sense."""

    problem: str
    since_ns: int
    answers: int


class Fade:
    """The share of the force that is displayed: it fades while commands are stale.

    Parameters
    ----------
    stale_ns, ramp_ns
        The force fades to zero within `ramp_ns` when no command has come for `stale_ns`, and comes
        back as slowly.
    """

    def __init__(self, stale_ns: int, ramp_ns: int) -> None:
        self._stale_ns, self._ramp_ns = stale_ns, ramp_ns
        self._last_ns: int | None = None
        self.share = 0.0

    def step(self, now_ns: int, command_ns: int | None) -> tuple[float, bool]:
        """Return the share now, and whether it begins to fade."""
        passed_ns = 0 if self._last_ns is None else now_ns - self._last_ns
        self._last_ns = now_ns
        change = min(passed_ns, _LONGEST_STEP_NS) / self._ramp_ns
        if command_ns is not None and now_ns - command_ns < self._stale_ns:
            self.share = min(self.share + change, 1.0)
            return self.share, False
        begins = self.share == 1.0
        self.share = max(self.share - change, 0.0)
        return self.share, begins

    def cut(self) -> None:
        """Take the force away at once."""
        self.share = 0.0


class Servo(ABC):
    """One device, in the thread that talks with the service.

    Other threads read `measured`, which is replaced as a whole, and write what they command.

    Parameters
    ----------
    found
        The device.
    stale_ms
        For how long a command holds.
    clock
        Monotonic time (ns).
    """

    def __init__(
        self, found: Found, stale_ms: float, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.device, self._names = found.device, found.names
        self.kind = kind_of(found.entry)
        self.clock = clock
        self.stale_ns = round(stale_ms * 1e6)
        self.command_ns: int | None = None
        """When the newest command came."""
        self.measured: Measured | None = None
        self.senseless: Senseless | None = None
        self.fault = ""
        """What ends this connection, empty while it goes on."""
        self.answers = 0
        self.counts: Counter[str] = Counter()
        self.calibrated: bool | None = None
        """As the service says; None where it does not tell."""
        self.needs_calibration = False
        """Whether a position without calibration makes no sense."""
        self.powered = read_flag(found.entry, "power_supply")
        self.used_elsewhere = read_flag(found.entry, "in_use") is True
        """Whether another program had the device when this one came."""
        self._watch = Watch()
        self._judge(found.entry, clock())

    def greet(self) -> str:
        """Return the first message to the service."""
        return greeting(self.device, self._names)

    def release(self) -> str:
        """Return the message that takes the force away."""
        return force_command(self.device, self._names, NO_FORCE)

    @abstractmethod
    def speak(self, now_ns: int) -> str:
        """Return the next message to the service."""

    def hear(self, text: str) -> None:
        """Take an answer of the service."""
        self.answers += 1
        try:
            entry = listed(parse(text)).get(self.device)
        except (ValueError, OtherFormatError):
            self._distrust(UNREADABLE, self.clock())
            return
        if entry is None:
            self._distrust(ABSENT, self.clock())
        else:
            self._judge(entry, self.clock())

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
        self.senseless = None
        self.measured = Measured(position, velocity, now_ns)

    def _distrust(self, problem: str, now_ns: int) -> None:
        """Take the force away: the answer makes no sense."""
        self.counts[problem] += 1
        before = self.senseless
        since_ns, answers = (now_ns, 0) if before is None else (before.since_ns, before.answers)
        self.senseless = Senseless(problem, since_ns, answers + 1)


AnyServo = TypeVar("AnyServo", bound=Servo)


class ForceServo(Servo):
    """Displays a force, for the handle.

    Parameters
    ----------
    found, stale_ms, clock
        See `Servo`.
    ramp_ms
        See `Fade`.
    """

    def __init__(
        self,
        found: Found,
        stale_ms: float,
        ramp_ms: float,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(found, stale_ms, clock)
        self._fade = Fade(self.stale_ns, round(ramp_ms * 1e6))
        self.force_n: Vector = NO_FORCE
        """What is commanded, in the device's axes."""
        self.displayed_n: Vector = NO_FORCE
        """What the service was told last."""

    def speak(self, now_ns: int) -> str:
        """Return the command of the force, faded."""
        if self.senseless is not None:
            self._fade.cut()
            self.displayed_n = NO_FORCE
            return self.release()
        share, begins = self._fade.step(now_ns, self.command_ns)
        if begins:
            self.counts["stale commands"] += 1
        x, y, z = self.force_n
        self.displayed_n = (share * x, share * y, share * z)
        return force_command(self.device, self._names, self.displayed_n)
