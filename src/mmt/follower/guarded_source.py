"""The follower's work in each tick: drive its source as commanded, and measure."""

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from mmt.core.arrays import RecordArray
from mmt.devices.protocols import Vector
from mmt.follower.command_guard import CommandGuard
from mmt.follower.motion_limit import MotionLimit
from mmt.follower.sources import DeviceBackedSource, FollowerSource
from mmt.scene import Link, Scene, Texture

if TYPE_CHECKING:
    from mmt.follower.feedback import FollowerFeedback


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
        self.guard = None if scene.replay is not None else _guard(scene, say)
        """The command guard; None if a recording is replayed, which follows no commands."""
        limits = scene.motion_limits
        self._limit = None
        if limits is not None:
            limit_mm_s = (scene.link or Link()).limit_mm_s
            self._limit = MotionLimit(limits, limit_mm_s, scene.session.rate_hz)
        self._of_devices = source if isinstance(source, DeviceBackedSource) else None
        if self._of_devices is not None:
            self._of_devices.on_loss(self._on_device)
            self._of_devices.on_late_frames(self._take_late)

    @property
    def summary(self) -> dict[str, dict[str, Any]]:
        """Counts so far, a table for each part of the follower's summary."""
        return {
            "commands": self.guard.summary if self.guard is not None else {},
            "devices": dict(self._of_devices.summary) if self._of_devices is not None else {},
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
        if self._newest is None:
            return None
        x, y, z = self._newest["position_mm"][-1].tolist()
        return (x, y, z) if math.isfinite(x + y + z) else None

    def _on_device(self, lost: bool, sentence: str) -> None:
        """Apply the scene's `on_lost` while a device is lost."""
        devices = self._devices
        if self.guard is None or devices is None or devices.on_lost == "stop":
            return
        if lost:
            self._newest = None
            self.guard.halt(devices.on_lost)
        else:
            self.guard.release()
            if self._limit is not None:
                self._limit.restart()
        does = "holding" if devices.on_lost == "hold" else "retracting"
        self._say(f"{sentence}{f': {does}' if lost else ': taking commands again'}")


def _guard(scene: Scene, say: Callable[[str], None]) -> CommandGuard:
    return CommandGuard(
        scene.link or Link(),
        scene.session.rate_hz,
        (scene.texture or Texture()).normal,
        measures_position="position" in scene.channels(),
        say=say,
        box_mm=scene.motion_limits.box_mm if scene.motion_limits is not None else None,
    )
