"""The part of the leader that answers LeRobot's requests, and a handle that follows its actions."""

import time
from collections import deque
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.arrays import RecordArray, Vector, clipped, difference
from mmt.core.errors import DeviceLost, InputError
from mmt.core.frames import FIELD_OF_CHANNEL, acceleration_samples
from mmt.devices.leader_reports import InterfaceState
from mmt.leader.part import Part, Session, Tick
from mmt.texture.settings import Axis

if TYPE_CHECKING:
    import asyncio

    from mmt.leader.motion.hand import HandPart


_TICK_S: Final = 1e-3
_AT_REST: Final[Vector] = (0.0, 0.0, 0.0)
_LONGEST_PERIOD: Final = 200
"""Longest time between two actions in ticks; a later action begins a new motion."""
_CONTACT_N: Final = 0.05


class ActionHandle:
    """Go from action to action in straight lines; implements `LeaderInterface`.

    The time to reach an action is the time between this action and the one before, so that the
    motion is continuous, and one period late. The first action, and one after a pause of over
    0.2 s, is approached at a bounded speed. Before the first there is no state and no command.

    The hand's normal force is the displayed force, as with a real handle at rest.

    Parameters
    ----------
    recovery_mm_s
        Largest speed towards the first action, and after a pause.
    box_mm
        Lowest and highest corner of a box to which actions are clipped, or None.
    normal
        The surface's normal axis.
    """

    def __init__(
        self,
        recovery_mm_s: float = 50.0,
        box_mm: tuple[Vector, Vector] | None = None,
        normal: Axis = "z",
    ) -> None:
        self._recovery_mm = recovery_mm_s * _TICK_S
        self._normal = "xyz".index(normal)
        self._box = box_mm
        self._position: Vector | None = None
        self._target: Vector = _AT_REST
        self._step: Vector = _AT_REST  # in a tick
        self._left = 0  # ticks until the target is reached
        self._since = _LONGEST_PERIOD + 1  # ticks since the last action
        self._force_n = 0.0

    def connect(self) -> None:
        """Do nothing: there is no device."""

    def calibrate(self) -> None:
        """Do nothing: there is no device."""

    def close(self) -> None:
        """Do nothing: there is no device."""

    def follow(self, action_mm: Vector, start_mm: Vector | None) -> Vector:
        """Take an action (mm), and return it as clipped to the box.

        Parameters
        ----------
        start_mm
            Position of the robot, used at the first action; None if it is not known.
        """
        self._target = action_mm if self._box is None else clipped(action_mm, *self._box)
        if self._position is None:
            self._position = self._target if start_mm is None else start_mm
        way = difference(self._target, self._position)
        if self._since > _LONGEST_PERIOD:
            self._left = max(1, round(sum(a * a for a in way) ** 0.5 / self._recovery_mm))
        else:
            self._left = max(1, self._since)
        self._step = (way[0] / self._left, way[1] / self._left, way[2] / self._left)
        self._since = 0
        return self._target

    def read(self, elapsed_ticks: int) -> InterfaceState | None:
        """Advance by the ticks and return the state, or None before the first action."""
        self._since = min(self._since + elapsed_ticks, _LONGEST_PERIOD + 1)
        if self._position is None:
            return None
        velocity = _AT_REST
        if self._left > 0:
            u, v, w = self._step
            velocity = (u / _TICK_S, v / _TICK_S, w / _TICK_S)
            self._left -= elapsed_ticks
            x, y, z = self._position
            go = elapsed_ticks
            moved = (x + go * u, y + go * v, z + go * w)
            self._position = moved if self._left > 0 else self._target
        pressed_n = max(self._force_n, 0.0)
        return InterfaceState(self._position, velocity, pressed_n, pressed_n > _CONTACT_N)

    def write(self, force_n: Vector) -> None:
        """Take the force (N) that a hand would feel."""
        self._force_n = force_n[self._normal]


LONGEST_FRAMES: Final = 100
"""The level of vibration is taken since the last observation, over at most this many frames."""
_OLDEST_S: Final = 0.5
"""Greatest age of what is observed; several delays of a network."""


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
        self._arrival_ns = 0
        self._accelerations: deque[list[float]] = deque(
            maxlen=LONGEST_FRAMES * session.samples_per_frame
        )
        self._level_m_s2 = 0.0

    def on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        """Keep the newest of the frames (n,), n >= 1, and their acceleration."""
        self._newest, self._arrival_ns = frames[-1], arrival_ns
        if self._vibrates:
            self._accelerations.extend(acceleration_samples(frames).tolist())

    def tick(self, _tick: Tick) -> None:
        """Set `ready` when there is something to observe."""
        if self._newest is None or self._ready.is_set():
            return
        if self._handle is not None or self._hand.command_mm is not None:
            self._ready.set()

    def observe(self) -> list[float]:
        """Return the newest state, in the order of `mmt_bridges.lerobot.dataset.state_names`.

        Raises
        ------
        DeviceLost
            The follower is not connected, or sends no frames.
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
            The follower is not connected, or sends no frames.
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
            The follower is not connected, or sends no frames.
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
        age_s = 1e-9 * (time.monotonic_ns() - self._arrival_ns)
        if age_s > _OLDEST_S:
            raise DeviceLost(
                f"no frame of the follower has come for {age_s:.1f} s: what LeRobot would record "
                "is old; see whether a device of the follower, or the network, is lost"
            )
