"""Keep a robot safe when commands stop, arrive late, or jump."""

import math
import struct
from collections import deque
from collections.abc import Callable
from typing import Any, Final, Literal

from mmt.core.arrays import RecordArray, Vector, clipped, difference, step_towards
from mmt.core.output.logs import RepeatLimit
from mmt.core.sequence_numbers import steps_ahead
from mmt.follower.round_trips import EchoCheck, SilenceLimit
from mmt.scene import Link

_COMMAND: Final = struct.Struct("<Iqqq3f")
"""Layout of `mmt.core.frames.COMMAND_DTYPE`; NumPy takes over twice as long to read a command."""

_AT_REST: Final[Vector] = (0.0, 0.0, 0.0)

_REMEMBERED: Final = 50
"""Commands over which the hand's speed is taken while the robot is behind. From one command to the
next the stamps are uneven if the leader's ticks are late, by as much as two ticks for one."""

_NORMALS: Final[dict[str, Vector]] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
}


class CommandGuard:
    """Turn the leader's commands into positions that a robot can take without harm.

    - A command whose round trip was too long is dropped, because the hand has moved since. A
      command that echoes no frame that was sent is dropped, because its age is unknown.
    - If no fresh command has come for the time of `SilenceLimit`, by the follower's own ticks, the
      robot holds the last position, or retracts from the surface along its normal. The robot does
      the same while a device is lost (`halt`).
    - The position begins where the robot is. Its distance to the commands, at the start or after a
      silence, a stall or a jump, is reduced at `recovery_mm_s`, in addition to the hand's own
      motion by the leader's clock.
    - In each call the position moves by no more than `limit_mm_s` allows in one tick, even if the
      call makes up for missed ticks.
    - A command outside the workspace is clipped to it.

    About 2 us a tick.

    Parameters
    ----------
    link
        The scene's ``[link]``.
    rate_hz
        Ticks a second.
    normal
        The surface's normal axis; away from the surface it is positive.
    measures_position
        Whether `step` gets the robot's position; else the position starts at the first command.
    say
        Called with a sentence when commands stop, come again, or leave the workspace.
    box_mm
        Lowest and highest corner of the workspace, or None.
    """

    def __init__(
        self,
        link: Link,
        rate_hz: float,
        normal: str,
        *,
        measures_position: bool,
        say: Callable[[str], None],
        box_mm: tuple[Vector, Vector] | None = None,
    ) -> None:
        self._link = link
        self._rate_hz = rate_hz
        self._measures_position = measures_position
        self._say = say
        self._silence = SilenceLimit(link)
        self._stale_ns = round(link.stale_ms * 1e6)
        self._period_ns = round(1e9 / rate_hz)
        self._recovery_mm = link.recovery_mm_s / rate_hz
        self._limit_mm = link.limit_mm_s / rate_hz
        self._normal = _NORMALS[normal]
        self._box = box_mm
        self._outside = False
        self._told = RepeatLimit()
        self.echoes = EchoCheck()
        """Must be told of each connection and of the frames sent."""
        self._command: Vector | None = None  # came since the last tick
        self._target = _AT_REST
        self._motion = _AT_REST  # of the hand, in a tick
        self._command_ns = self._target_ns = 0  # by the leader's clock
        self._before: deque[tuple[int, Vector]] = deque(maxlen=_REMEMBERED)
        self._position: Vector | None = None
        self._age_ticks = 0
        self._arrived = (0, 0)  # number and time of the newest command, also of a stale one
        self._reason: str | None = None
        self._silent = False
        self._halted = False
        self._halts = self._halted_ticks = 0
        self._silences = self._silent_ticks = self._slowed = self._clipped = 0
        self._stale = self._implausible = 0

    @property
    def summary(self) -> dict[str, Any]:
        """Counts and times so far, by name."""
        return {
            "silences": self._silences,
            "silence_limit_ms": round(self._silence.limit_ns / 1e6, 1),
            "silent_s": self._silent_ticks / self._rate_hz,
            "stale_commands": self._stale,
            "implausible_commands": self._implausible,
            "slowed_ticks": self._slowed,
            "clipped_commands": self._clipped,
            "halts": self._halts,
            "halted_s": self._halted_ticks / self._rate_hz,
        }

    @property
    def _silence_ticks(self) -> int:
        return max(1, round(self._silence.limit_ns / self._period_ns))

    def halt(self, does: Literal["hold", "retract"], *, of_robot: bool = False) -> None:
        """Hold or retract, because a device is lost, and take no commands until `release`.

        If that is the robot, it gets no position until then, and begins where it is.
        """
        if of_robot and self._measures_position:
            self._position, self._silent = None, False
        if self._halted:
            return  # the robot is at its target, or on the way
        self._halts += 1
        self._halted = True
        if self._position is not None:
            self._let_be(self._position, does)

    def release(self) -> None:
        """Take commands again; until one comes, the robot stays as it was halted."""
        self._halted = False

    def receive(self, commands: RecordArray, arrival_ns: int) -> None:
        """Take commands (n,), n >= 1, the newest last, with their arrival by this clock.

        The newest one is used, unless its round trip, from the frame that it echoes, was longer
        than `stale_ms`, or its echo is impossible.
        """
        number, time_ns, echo_time_ns, echo_age_ns, x, y, z = _COMMAND.unpack(
            commands[-1].tobytes()
        )
        if self._silent and self._reason is None:
            self._reason = self._reason_of(*commands[["sequence", "time_ns"]][0].tolist())
        self._arrived = number, time_ns
        round_trip_ns = self.echoes.round_trip_ns(echo_time_ns, echo_age_ns, arrival_ns)
        if round_trip_ns is None:
            self._implausible += len(commands)
            if self._told.allow("echo"):
                self._say("the leader's commands echo no frame that was sent: they are left out")
            return
        if round_trip_ns > self._stale_ns:
            self._stale += len(commands)
            return
        self._silence.add(round_trip_ns, arrival_ns)
        if math.isfinite(x + y + z):
            self._command, self._command_ns = self._clip((x, y, z)), time_ns

    def step(self, elapsed: int, measured: Callable[[], Vector | None]) -> Vector | None:
        """Return the position (mm) to take now, None before the first command.

        Parameters
        ----------
        elapsed
            Ticks since the last call.
        measured
            Returns the robot's position (mm), or None if it is not known yet; called until the
            first position is returned.
        """
        if self._halted:
            self._command = None
            self._age_ticks = 0
            self._halted_ticks += elapsed
        elif self._command is not None:
            self._follow(self._command, measured)
        elif self._position is not None:
            self._age_ticks += elapsed
            if self._age_ticks >= self._silence_ticks and not self._silent:
                self._fall_silent()
        if self._position is None:
            return None
        if self._silent:
            self._silent_ticks += 0 if self._halted else elapsed
            most_mm = min(self._recovery_mm * elapsed, self._limit_mm)
            self._position = step_towards(self._position, self._target, most_mm)
        else:
            self._advance(self._position, elapsed)
        return self._position

    def _clip(self, command: Vector) -> Vector:
        """Return the command, clipped to the workspace; count and report one that is outside."""
        inside = command if self._box is None else clipped(command, *self._box)
        outside = inside != command
        if outside and not self._outside and self._told.allow("outside"):
            x, y, z = command
            self._say(f"commanded to ({x:.0f}, {y:.0f}, {z:.0f}) mm, outside workspace_mm: clipped")
        self._outside = outside
        self._clipped += outside
        return inside

    def _follow(self, command: Vector, measured: Callable[[], Vector | None]) -> None:
        if self._position is None:
            self._position = measured() if self._measures_position else command
            if self._position is None:
                return
            self._motion = _AT_REST
        elif self._silent:
            self._motion = _AT_REST
            self._silent = False
            if self._age_ticks and self._told.allow("back"):
                silent_s = self._age_ticks / self._rate_hz
                self._say(
                    f"leader is back after {silent_s:.2g} s{self._reason or ''}: "
                    f"taking up its commands at {self._link.recovery_mm_s:g} mm/s"
                )
        else:
            self._motion = self._since(self._target_ns, self._target, command)
            if self._position is not self._target and self._before:
                # the slower of both: a jump or two commands close in time look too fast
                self._motion = min(self._motion, self._since(*self._before[0], command), key=_norm)
        self._target, self._target_ns = command, self._command_ns
        self._before.append((self._command_ns, command))
        self._command = None
        self._age_ticks = 0

    def _since(self, before_ns: int, before: Vector, command: Vector) -> Vector:
        """Return the hand's mean motion per tick since an earlier command."""
        ticks = max(1.0, (self._command_ns - before_ns) / self._period_ns)
        x, y, z = difference(command, before)
        return (x / ticks, y / ticks, z / ticks)

    def _fall_silent(self) -> None:
        assert self._position is not None  # noqa: S101 - there is none to hold before a command
        self._silences += 1
        self._let_be(self._position, self._link.on_silence)
        does = "holding" if self._link.on_silence == "hold" else "retracting"
        if self._told.allow("silent"):
            self._say(f"leader silent for {self._silence_ticks / self._rate_hz:g} s: {does}")

    def _reason_of(self, number: int, time_ns: int) -> str:
        """Return why commands were missing, from the first one after a silence; "" if unclear."""
        before, before_ns = self._arrived
        lost, passed = steps_ahead(number, before) - 1, (time_ns - before_ns) / self._period_ns
        half = self._silence_ticks / 2
        if not 0 <= lost <= passed + half:
            return ""  # from another leader, whose numbers start again
        if lost >= half:
            return f" and {lost} lost commands"
        paused = passed - lost >= half
        return ", in which it sent nothing" if paused else ", in which the network held it up"

    def _let_be(self, position: Vector, does: Literal["hold", "retract"]) -> None:
        """Set the target for the time without commands."""
        self._silent, self._reason = True, None
        self._before.clear()
        away_mm = self._link.retract_mm if does == "retract" else 0.0
        x, y, z = position
        u, v, w = self._normal
        away = (x + away_mm * u, y + away_mm * v, z + away_mm * w)
        self._target = away if self._box is None else clipped(away, *self._box)

    def _advance(self, position: Vector, elapsed: int) -> None:
        """Move with the hand, as far as that approaches the target, and by the recovery."""
        x, y, z = position
        u, v, w = self._motion
        behind = difference(self._target, position)
        along, square = behind[0] * u + behind[1] * v + behind[2] * w, u * u + v * v + w * w
        share = min(max(along / square, 0.0), float(elapsed)) if square > 0.0 else 0.0
        moved = (x + share * u, y + share * v, z + share * w)
        wanted = step_towards(moved, self._target, self._recovery_mm * elapsed)
        self._position = step_towards(position, wanted, self._limit_mm)
        if self._position is not self._target:
            self._slowed += elapsed


def _norm(vector: Vector) -> float:
    return math.hypot(*vector)
