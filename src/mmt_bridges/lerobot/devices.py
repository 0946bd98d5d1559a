"""The follower as a robot of LeRobot, and the leader's hand as its teleoperator.

Names and units are those of an exported data set, see `mmt_bridges.lerobot.dataset`.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from typing import Any, Final, cast

from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.datasets import pipeline_features
from lerobot.robots import Robot
from lerobot.teleoperators import Teleoperator
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from mmt.core.arrays import Vector
from mmt.core.errors import MmtError
from mmt.core.frames import ALL_CHANNELS
from mmt.session.data import axis_columns
from mmt_bridges.lerobot.config_devices import MmtRobotConfig, MmtTeleoperatorConfig
from mmt_bridges.lerobot.dataset import state_names
from mmt_bridges.lerobot.rows import FELT, STATE
from mmt_bridges.lerobot.session import SharedSession, shared_session
from mmt_bridges.lerobot.settings import MovedBy, Settings

ACTION_NAMES: Final = axis_columns("position")

_OWN_NAMES: Final = frozenset(state_names(ALL_CHANNELS))

_SAME_MM: Final = 1e-3
"""Tolerance by which two actions are the same: LeRobot's processors may round them."""


def _with_what_is_felt(made: Callable[..., dict[str, Any]]) -> Callable[..., dict[str, Any]]:
    """Add force and vibration as the environment's state to the features of a data set of mmt.

    LeRobot puts every number of a robot into the robot's state, but policies without pictures need
    an environment's state. LeRobot offers no other way to declare one.
    """

    @wraps(made)
    def features(values: Mapping[str, Any], prefix: str, *args: Any, **options: Any) -> Any:
        found = made(values, prefix, *args, **options)
        names = found.get(STATE, {}).get("names", ())
        felt = [name for name in names if name not in ACTION_NAMES]
        if felt and set(names) <= _OWN_NAMES:
            found[FELT] = {**found[STATE], "shape": (len(felt),), "names": felt}
        return found

    return features


pipeline_features.hw_to_dataset_features = _with_what_is_felt(
    pipeline_features.hw_to_dataset_features
)


@contextmanager
def _told_to_lerobot() -> Iterator[None]:
    try:
        yield
    except MmtError as error:
        raise DeviceNotConnectedError(f"mmt: {error}") from None


class _SessionDevice:
    """A device of LeRobot that uses the session of leader and follower."""

    _session: SharedSession
    _title: str
    """Name of the device in messages."""
    _used = False

    @property
    def is_connected(self) -> bool:
        """Whether the session runs, and this device uses it."""
        return self._used and self._session.running

    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002 - the session does it
        """Start the session, unless the other device has started it, and wait for the first frame.

        Raises
        ------
        DeviceNotConnectedError
            The session cannot begin; the message says why.
        """
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self._title} is already connected")
        with _told_to_lerobot():
            self._session.acquire(self)
        self._used = True

    @property
    def action_features(self) -> dict[str, type]:
        """Commanded position (mm)."""
        return dict.fromkeys(ACTION_NAMES, float)

    @property
    def is_calibrated(self) -> bool:
        """Always True: leader and follower calibrate their devices at each start."""
        return True

    def calibrate(self) -> None:
        """Do nothing, see `is_calibrated`."""

    def configure(self) -> None:
        """Do nothing: the scene says how devices are set."""

    def disconnect(self) -> None:
        """End the session, unless the other device still uses it.

        Raises
        ------
        DeviceNotConnectedError
            The device is not connected.
        """
        self._require()
        self._used = False
        self._session.release(self)

    def _require(self) -> None:
        if not self._used:
            raise DeviceNotConnectedError(f"{self._title} is not connected: call connect() first")


class MmtRobot(_SessionDevice, Robot):
    """The follower's robot: its measured state, and the command that it follows.

    With ``moved_by="hand"`` the leader commands the robot at 1 kHz by the scene's hand, and
    `send_action` returns the current command. With ``moved_by="actions"`` the robot moves from
    action to action in straight lines.

    Parameters
    ----------
    config
        Options.

    Raises
    ------
    InputError
        The scene or an option cannot be used; the message says why.
    """

    config_class = MmtRobotConfig
    name = "mmt"
    _title = "the robot"

    def __init__(self, config: MmtRobotConfig) -> None:
        super().__init__(config)
        self.config = config
        self.cameras: dict[str, Any] = make_cameras_from_configs(config.cameras)
        """Cameras of a LeRobot set-up, whose pictures are passed on."""
        moved_by = cast("MovedBy", config.moved_by)  # the settings check it
        settings = Settings(config.scene, config.follower, moved_by, config.wait_s)
        self._session = shared_session(config.scene, settings)
        self._names = state_names(self._session.scene.channels())

    @property
    def observation_features(self) -> dict[str, Any]:
        """Position (mm), force (N), level of vibration (m/s2) if in the scene; cameras' shapes."""
        pictures = {name: (c.height, c.width, 3) for name, c in self.config.cameras.items()}
        return dict.fromkeys(self._names, float) | pictures

    def connect(self, calibrate: bool = True) -> None:
        """Start the session, unless the teleoperator has started it, and the cameras.

        Raises
        ------
        DeviceNotConnectedError
            The session cannot begin; the message says why.
        """
        super().connect(calibrate)
        try:
            for camera in self.cameras.values():
                camera.connect()
        except BaseException:
            self.disconnect()
            raise

    def disconnect(self) -> None:
        """Disconnect the cameras; end the session, unless the teleoperator still uses it.

        Raises
        ------
        DeviceNotConnectedError
            The robot is not connected.
        """
        super().disconnect()
        for camera in self.cameras.values():
            if camera.is_connected:
                camera.disconnect()

    def get_observation(self) -> dict[str, Any]:
        """Return the newest state, and a picture of each camera.

        Raises
        ------
        DeviceNotConnectedError
            The robot is not connected, or the follower was lost.
        """
        self._require()
        with _told_to_lerobot():
            state = dict(zip(self._names, self._session.ask("observe"), strict=True))
        return state | {name: camera.async_read() for name, camera in self.cameras.items()}

    def send_action(self, action: Mapping[str, Any]) -> dict[str, float]:
        """Return the current command; with ``moved_by="actions"``, first set it to the action.

        Raises
        ------
        ValueError
            The action lacks a component, is not finite, or did not come from the scene's hand.
        DeviceNotConnectedError
            The robot is not connected, or the follower was lost.
        """
        self._require()
        session, wanted = self._session, _position(action)
        with _told_to_lerobot():
            if session.settings.moved_by == "actions":
                return _action(session.ask("follow", wanted))
            if session.given is None or math.dist(wanted, session.given) > _SAME_MM:
                raise ValueError(
                    "this action is not one of mmt's teleoperator, and the scene's hand moves the "
                    "robot: set --robot.moved_by=actions for a policy, a replay or another "
                    "teleoperator"
                )
            return _action(session.ask("command"))


class MmtTeleoperator(_SessionDevice, Teleoperator):
    """The leader's hand; the force that it feels comes from mmt's own loop at 1 kHz.

    Parameters
    ----------
    config
        Options.

    Raises
    ------
    InputError
        There is no such scene.
    """

    config_class = MmtTeleoperatorConfig
    name = "mmt"
    _title = "the teleoperator"

    def __init__(self, config: MmtTeleoperatorConfig) -> None:
        super().__init__(config)
        self.config = config
        self._session = shared_session(config.scene)

    @property
    def feedback_features(self) -> dict[str, type]:
        """Empty: LeRobot gives the hand nothing to feel."""
        return {}

    def connect(self, calibrate: bool = True) -> None:
        """Start the session, unless the robot has started it, and wait for the first frame.

        Raises
        ------
        ValueError
            Actions move the robot, not a hand.
        DeviceNotConnectedError
            The session cannot begin; the message says why.
        """
        if self._session.settings.moved_by == "actions":
            raise ValueError(
                "with --robot.moved_by=actions there is no hand for --teleop.type=mmt: leave one "
                "of them out"
            )
        super().connect(calibrate)

    def get_action(self) -> dict[str, float]:
        """Return the position (mm) that the hand commands.

        Raises
        ------
        DeviceNotConnectedError
            The teleoperator is not connected, or the follower was lost.
        """
        self._require()
        with _told_to_lerobot():
            given = self._session.given = self._session.ask("command")
        return _action(given)

    def send_feedback(self, feedback: Mapping[str, Any]) -> None:
        """Accept only empty feedback.

        Raises
        ------
        ValueError
            The feedback is not empty.
        DeviceNotConnectedError
            The teleoperator is not connected.
        """
        self._require()
        if feedback:
            raise ValueError(
                f"{', '.join(feedback)}: the hand feels what [force_feedback] of the scene gives, "
                "at 1 kHz; LeRobot cannot add to it"
            )


def _position(action: Mapping[str, Any]) -> Vector:
    lacking = [name for name in ACTION_NAMES if name not in action]
    if lacking:
        raise ValueError(f"an action lacks {', '.join(lacking)}; it has {', '.join(action)}")
    x, y, z = (float(action[name]) for name in ACTION_NAMES)
    if not math.isfinite(x + y + z):
        raise ValueError(f"an action is not finite: {x}, {y}, {z} mm")
    return (x, y, z)


def _action(position_mm: Sequence[float]) -> dict[str, float]:
    return dict(zip(ACTION_NAMES, position_mm, strict=True))
