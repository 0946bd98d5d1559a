"""The follower's work in each tick: drive its source as commanded, within limits, and measure."""

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, cast

from mmt.core.arrays import RecordArray, Vector, clipped, difference, step_towards
from mmt.follower.command_guard import CommandGuard
from mmt.follower.sources import FollowerSource
from mmt.scene import Link, MotionLimits, Scene

if TYPE_CHECKING:
    from mmt.devices.streaming.source import DeviceSource
    from mmt.follower.feedback import FollowerFeedback

_AT_REST: Final[Vector] = (0.0, 0.0, 0.0)


class MotionLimit:
    """The last bound on the positions that are sent to a robot, whatever their source.

    - A position outside the workspace is clipped to it. A robot that begins outside goes no
      farther out.
    - Along each axis the velocity changes by no more than the acceleration limit allows.
    - Along each axis the robot can always stop, within that limit, at the wanted position or
      before it. So it overshoots neither this position nor the workspace, unless the wanted
      position jumps to a point at which the robot can no longer stop.
    - A call moves the robot by no more than the speed limit allows in one tick, even if it makes
      up for missed ticks. The robot stood still in those and is assumed to have slowed down.

    At a speed v the robot follows about v²/2a behind; exactly if the acceleration of one tick is
    enough to stop it. About 5 us a tick.

    Parameters
    ----------
    limits
        The follower's ``[devices]`` or ``[simulated]``.
    limit_mm_s
        Largest speed.
    rate_hz
        Ticks a second.
    """

    def __init__(self, limits: MotionLimits, limit_mm_s: float, rate_hz: float) -> None:
        self._box = limits.box_mm
        most = limits.acceleration_limit_mm_s2
        self._change_mm = math.inf if most == "off" else most / rate_hz**2
        self._fastest_mm = limit_mm_s / rate_hz
        self._position: Vector | None = None
        self._velocity = _AT_REST  # mm a tick

    @property
    def begun(self) -> bool:
        """Whether there is a position that the next one is bounded by."""
        return self._position is not None

    def restart(self, position: Vector | None = None) -> None:
        """Begin at rest at a position (mm), or at the next one."""
        self._position, self._velocity = position, _AT_REST

    def step(self, elapsed: int, wanted: Vector | None) -> Vector | None:
        """Return the position (mm) to take now, None before the first.

        Parameters
        ----------
        elapsed
            Ticks since the last call, at least 1.
        wanted
            Position (mm) to go to; if it is None or not finite, the robot stops.
        """
        known = wanted is not None and math.isfinite(sum(wanted))
        here = self._position
        if here is None:
            self._position = wanted if known else None
            return self._position
        goal = wanted if wanted is not None and known else here
        if self._box is not None:
            low, high = self._box
            goal = clipped(goal, _each(min, low, here), _each(max, high, here))
        velocity = self._next_velocity(here, goal, self._slowed(elapsed - 1))
        x, y, z = (
            there if there - place == step else place + step
            for place, there, step in zip(here, goal, velocity, strict=True)
        )
        self._position, self._velocity = (x, y, z), velocity
        return self._position

    def _slowed(self, missed: int) -> Vector:
        """Return the velocity after missed ticks, in which the robot was not moved."""
        if not missed:
            return self._velocity
        less = missed * self._change_mm
        x, y, z = (math.copysign(max(abs(v) - less, 0.0), v) for v in self._velocity)
        return (x, y, z)

    def _next_velocity(self, here: Vector, goal: Vector, velocity: Vector) -> Vector:
        """Return the velocity (mm a tick) of the next tick."""
        change = self._change_mm
        wanted = difference(step_towards(here, goal, self._fastest_mm), here)
        steps = []
        for want, distance, before in zip(wanted, difference(goal, here), velocity, strict=True):
            most = _stoppable(abs(distance), change)
            step = max(-most, min(want, most))
            steps.append(max(before - change, min(step, before + change)))
        if math.hypot(*steps) > self._fastest_mm * (1.0 + 1e-9):
            # No axis gets faster while another still has to slow down.
            steps = [_no_faster(step, v) for step, v in zip(steps, velocity, strict=True)]
        x, y, z = steps
        return (x, y, z)


def _each(choose: Callable[[float, float], float], first: Vector, second: Vector) -> Vector:
    x, y, z = map(choose, first, second)
    return (x, y, z)


def _stoppable(distance_mm: float, change_mm: float) -> float:
    """Return the largest step (mm) after which the robot can stop within a distance.

    Each of the following steps is shorter by `change_mm`: after n of them the path has the length
    (n + 1) step - change n (n + 1) / 2.
    """
    if distance_mm <= change_mm:
        return distance_mm
    count = int((math.sqrt(1.0 + 8.0 * distance_mm / change_mm) - 1.0) / 2.0)
    return distance_mm / (count + 1) + 0.5 * change_mm * count


def _no_faster(step: float, before: float) -> float:
    """Return the step, or the nearest one that is no longer than the step before."""
    if abs(step) <= abs(before):
        return step
    return before if step * before > 0.0 else 0.0


class GuardedSource:
    """A source whose commands are guarded, and bounded by force feedback and motion limits.

    Parameters
    ----------
    scene
        The scene to run.
    source
        Takes the commands and gives the frames.
    feedback
        The follower's side of force feedback, or None.
    say
        Called with a sentence for the user.
    send
        Called between two ticks with values such as `step` returns, for frames that were not ready
        at their tick.
    """

    def __init__(
        self,
        scene: Scene,
        source: FollowerSource,
        feedback: "FollowerFeedback | None",
        say: Callable[[str], None],
        send: Callable[[RecordArray, RecordArray | None], None],
    ) -> None:
        self._source = source
        self._send = send
        self._feedback = feedback
        self._say = say
        self._devices = scene.devices
        self._newest: RecordArray | None = None
        self._measures_position = "position" in scene.channels()
        link, rate_hz, limits = scene.link or Link(), scene.session.rate_hz, scene.motion_limits
        self.guard: CommandGuard | None = None
        """The command guard; None if a recording is replayed, which follows no commands."""
        if scene.replay is None:
            self.guard = CommandGuard(
                link,
                rate_hz,
                scene.normal,
                measures_position=self._measures_position,
                say=say,
                box_mm=None if limits is None else limits.box_mm,
            )
        self._limit = None if limits is None else MotionLimit(limits, link.limit_mm_s, rate_hz)
        self.of_devices: DeviceSource | None = None
        """The source if it reads devices, which may be lost and come back."""
        if self._devices is not None:
            self.of_devices = cast("DeviceSource", source)
            self.of_devices.on_loss(self._on_device)
            self.of_devices.on_late_frames(self._take_late)

    @property
    def summary(self) -> dict[str, dict[str, Any]]:
        """Counts so far, a table for each part of the follower's summary."""
        return {
            "commands": self.guard.summary if self.guard is not None else {},
            "devices": dict(self.of_devices.summary) if self.of_devices is not None else {},
            "feedback": dict(self._feedback.summary) if self._feedback is not None else {},
        }

    def receive(self, commands: RecordArray, arrival_ns: int) -> None:
        """Take commands (n,), the newest last, with their arrival."""
        if self.guard is not None:
            self.guard.receive(commands, arrival_ns)

    def connect(self) -> None:
        """Prepare for a connection, whose leader has received no frame yet."""
        if self.guard is not None:
            self.guard.echoes.connect()

    def step(self, elapsed: int) -> tuple[RecordArray, RecordArray | None]:
        """Do the work of `elapsed` ticks, all but the last of which were missed.

        Returns
        -------
        frames
            Shape (n,), the ticks' frames; n is 0 if the source has none.
        news
            Shape (k,), records of the further event for the leader, or None.
        """
        guard, feedback = self.guard, self._feedback
        command = guard.step(elapsed, self._measured) if guard is not None else None
        if feedback is not None:
            command = feedback.command(command)
        if self._limit is not None:
            if command is not None and not self._limit.begun:
                self._limit.restart(self._measured())
            command = self._limit.step(elapsed, command)
        frames = self._source.step(elapsed, time.monotonic_ns(), command)
        return frames, self._measure(frames) if len(frames) else None

    def _take_late(self, frames: RecordArray) -> None:
        self._send(frames, self._measure(frames))

    def _measure(self, frames: RecordArray) -> RecordArray | None:
        """Note frames (n,), n >= 1, and return the feedback's records to send, or None."""
        self._newest = frames
        if self.guard is not None:
            self.guard.echoes.note(frames)
        return None if self._feedback is None else self._feedback.measured(frames)

    def _measured(self) -> Vector | None:
        """Return the robot's newest measured position, or None if none is known."""
        if self._newest is None or not self._measures_position:
            return None
        x, y, z = self._newest["position_mm"][-1].tolist()
        return (x, y, z) if math.isfinite(x + y + z) else None

    def _on_device(self, lost: bool, sentence: str, of_robot: bool) -> None:
        """Apply the scene's `on_lost` while a device is lost."""
        devices = self._devices
        if self.guard is None or devices is None or devices.on_lost == "stop":
            return
        if of_robot and self._limit is not None:
            self._limit.restart()
        if lost:
            self._newest = None
            self.guard.halt(devices.on_lost, of_robot=of_robot)
        else:
            self.guard.release()
        does = "holding" if devices.on_lost == "hold" else "retracting"
        self._say(f"{sentence}{f': {does}' if lost else ': taking commands again'}")
