"""The part of the leader that answers LeRobot's requests."""

from collections import deque
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.arrays import RecordArray, Vector
from mmt.core.errors import DeviceLost, InputError
from mmt.core.frames import FIELD_OF_CHANNEL, acceleration_samples
from mmt.leader.part import Part, Session, Tick
from mmt_bridges.lerobot.handle import ActionHandle

if TYPE_CHECKING:
    import asyncio

    from mmt.leader.motion.hand import HandPart

LONGEST_FRAMES: Final = 100
"""The level of vibration is taken since the last observation, over at most this many frames."""


class ObservingPart(Part):
    """Keep the newest frame, the acceleration since the last observation, and the command.

    Cost: about 1 us a tick.

    Parameters
    ----------
    session
        Session of the run.
    hand
        Commands the robot.
    ready
        Set when there is a frame and, if the scene's hand moves the robot, a command.
    """

    def __init__(self, session: Session, hand: "HandPart", ready: "asyncio.Event") -> None:
        self._session = session
        self._ready = ready
        self._hand = hand
        device = hand.device
        self._handle = device if isinstance(device, ActionHandle) else None
        channels = session.scene.channels()
        self._fields = [FIELD_OF_CHANNEL[c] for c in channels if c != "acceleration"]
        self._vibrates = "acceleration" in channels
        self._newest: Any = None
        self._accelerations: deque[list[float]] = deque(
            maxlen=LONGEST_FRAMES * session.samples_per_frame
        )
        self._level_m_s2 = 0.0

    def on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        """Keep the newest of the frames (n,), n >= 1, and their acceleration."""
        _ = arrival_ns
        self._newest = frames[-1]
        if self._vibrates:
            self._accelerations.extend(acceleration_samples(frames).tolist())

    def tick(self, tick: Tick) -> None:
        """Set `ready` when there is something to observe."""
        _ = tick
        if self._newest is None or self._ready.is_set():
            return
        if self._handle is not None or self._hand.command_mm is not None:
            self._ready.set()

    def observe(self) -> list[float]:
        """Return the newest state, in the order of `mmt_bridges.lerobot.dataset.state_names`.

        Raises
        ------
        DeviceLost
            The follower is not connected.
        """
        self._require_follower()
        state = [value for field in self._fields for value in self._newest[field].tolist()]
        if self._vibrates:
            if self._accelerations:
                variances = np.var(np.array(self._accelerations), axis=0)
                self._level_m_s2 = float(np.sqrt(variances.sum()))
                self._accelerations.clear()
            state.append(self._level_m_s2)
        return state

    def command(self) -> Vector:
        """Return the position (mm) that the follower was commanded last.

        Raises
        ------
        InputError
            Nothing was commanded yet.
        DeviceLost
            The follower is not connected.
        """
        self._require_follower()
        command: Vector | None = self._hand.command_mm
        if command is None:
            raise InputError("no action has come yet, and nothing is commanded")
        return command

    def follow(self, action_mm: Vector) -> Vector:
        """Move the robot to a position (mm), and return it as clipped to the workspace.

        Raises
        ------
        InputError
            The scene's hand moves the robot.
        DeviceLost
            The follower is not connected.
        """
        if self._handle is None:
            raise InputError("the scene's hand moves the robot, it follows no actions")
        self._require_follower()
        start = self._newest["position_mm"].tolist() if "position_mm" in self._fields else None
        return self._handle.follow(action_mm, start)

    def _require_follower(self) -> None:
        remote = self._session.remote
        if remote is None or not remote.connected or self._newest is None:
            raise DeviceLost("the follower is lost: what LeRobot would record is old")
