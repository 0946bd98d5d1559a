"""The robot and the teleoperator against a stand-in of LeRobot's base classes.

`test_lerobot_commands.py` has them in LeRobot's own commands, where it is installed.
"""

import importlib
import sys
from dataclasses import dataclass
from types import ModuleType, SimpleNamespace

import pytest

from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt_bridges.lerobot import session as sessions
from mmt_bridges.lerobot.session import SharedSession


class Config:
    """What both configurations are derived from."""

    @classmethod
    def register_subclass(cls, _):
        return lambda kind: kind


class Device:
    """What both devices are derived from."""

    def __init__(self, config):
        self.given_config = config


class Camera:
    """Gives its number of pictures."""

    def __init__(self, config):
        self.pictures, self.is_connected = 0, False
        self.there = config.fps > 0

    def connect(self):
        if not self.there:
            raise ConnectionError
        self.is_connected = True

    def disconnect(self):
        self.is_connected = False

    def async_read(self):
        self.pictures += 1
        return self.pictures


def made_cameras(configs):
    return {name: Camera(config) for name, config in configs.items()}


def made_features(values, prefix, use_video=True):
    names = [name for name, kind in values.items() if kind is float]
    return {f"{prefix}.state": {"dtype": "float32", "shape": (len(names),), "names": names}}


class NotConnectedError(ConnectionError): ...


class AlreadyConnectedError(ConnectionError): ...


STAND_IN = {
    "lerobot": {},
    "lerobot.cameras": {"CameraConfig": Config},
    "lerobot.cameras.utils": {"make_cameras_from_configs": made_cameras},
    "lerobot.datasets": {
        "pipeline_features": SimpleNamespace(hw_to_dataset_features=made_features)
    },
    "lerobot.robots": {"Robot": Device, "RobotConfig": Config},
    "lerobot.teleoperators": {"Teleoperator": Device, "TeleoperatorConfig": Config},
    "lerobot.utils": {},
    "lerobot.utils.errors": {
        "DeviceNotConnectedError": NotConnectedError,
        "DeviceAlreadyConnectedError": AlreadyConnectedError,
    },
}
STATE = [1.0, 2.0, -0.3, 0.1, 0.2, 1.5, 0.7]
NAMES = [f"position_{axis}_mm" for axis in "xyz"]


@dataclass
class Answers:
    """A session that runs, without a process."""

    running: bool = False
    command: tuple[float, float, float] = (1.1, 2.1, -0.5)
    problem: MmtError | None = None


@pytest.fixture
def devices(monkeypatch):
    for name, content in STAND_IN.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    own = ("mmt_bridges.lerobot.config_devices", "mmt_bridges.lerobot.devices")
    for name in own:
        monkeypatch.delitem(sys.modules, name, raising=False)
    yield importlib.import_module("mmt_bridges.lerobot.devices")
    for name in own:
        sys.modules.pop(name, None)


@pytest.fixture
def answers(monkeypatch):
    """Sessions answer as this says, in place of a process."""
    told = Answers()

    def start(_):
        if told.problem is not None:
            raise told.problem
        told.running = True

    def answer(_, what, action_mm=None):
        if told.problem is not None:
            raise told.problem
        if what == "follow":
            told.command = action_mm
        return STATE if what == "observe" else list(told.command)

    monkeypatch.setattr(sessions, "_SESSIONS", {})
    monkeypatch.setattr(SharedSession, "_start", start)
    monkeypatch.setattr(SharedSession, "ask", answer)
    monkeypatch.setattr(SharedSession, "_close", lambda _: setattr(told, "running", False))
    monkeypatch.setattr(SharedSession, "running", property(lambda _: told.running))
    return told


def robot_of(devices, **options):
    return devices.MmtRobot(devices.MmtRobotConfig(**options))


def teleoperator_of(devices, **options):
    return devices.MmtTeleoperator(devices.MmtTeleoperatorConfig(**options))


@pytest.mark.parametrize("robot_first", [True, False])
def test_both_use_one_session_in_either_order(devices, answers, robot_first):
    robot, hand = robot_of(devices), teleoperator_of(devices)
    order = [robot, hand] if robot_first else [hand, robot]
    for device in order:
        assert not device.is_connected
        device.connect()
        assert device.is_connected
        with pytest.raises(AlreadyConnectedError):
            device.connect()
    observation = robot.get_observation()
    assert list(observation) == list(robot.observation_features)
    assert list(observation.values()) == STATE
    assert set(robot.observation_features.values()) == {float}
    action = hand.get_action()
    assert action == dict(zip(NAMES, answers.command, strict=True))
    assert list(action) == list(hand.action_features) == list(robot.action_features)
    answers.command = (1.2, 2.2, -0.6)  # the hand has moved on
    assert robot.send_action(action) == dict(zip(NAMES, answers.command, strict=True))
    order[0].disconnect()
    assert not order[0].is_connected
    assert order[1].is_connected
    order[1].disconnect()
    assert not answers.running


def test_the_hand_does_not_follow_other_actions_and_takes_no_force(devices, answers):
    robot, hand = robot_of(devices), teleoperator_of(devices)
    robot.connect()
    with pytest.raises(ValueError, match=r"set --robot\.moved_by=actions"):
        robot.send_action(dict.fromkeys(NAMES, 0.0))
    hand.connect()
    hand.get_action()
    with pytest.raises(ValueError, match=r"set --robot\.moved_by=actions"):
        robot.send_action(dict.fromkeys(NAMES, 0.0))
    assert hand.feedback_features == {}
    hand.send_feedback({})
    with pytest.raises(ValueError, match="force_z_n: the hand feels what"):
        hand.send_feedback({"force_z_n": 1.0})


def test_actions_move_the_robot_where_the_options_say_so(devices, answers):
    robot, hand = robot_of(devices, moved_by="actions"), teleoperator_of(devices)
    with pytest.raises(ValueError, match="there is no hand"):
        hand.connect()
    robot.connect()
    action = dict(zip(NAMES, (3.0, 4.0, 5.0), strict=True))
    assert robot.send_action(action) == action
    assert answers.command == (3.0, 4.0, 5.0)
    with pytest.raises(ValueError, match="lacks position_z_mm"):
        robot.send_action(dict.fromkeys(NAMES[:2], 0.0))
    with pytest.raises(ValueError, match="not finite"):
        robot.send_action({**action, "position_x_mm": float("nan")})
    assert answers.command == (3.0, 4.0, 5.0)


def test_what_is_not_connected_says_so_and_needs_no_calibration(devices, answers):
    robot, hand = robot_of(devices), teleoperator_of(devices)
    for device in (robot, hand):
        device.calibrate()
        device.configure()
        assert device.is_calibrated
        assert not device.is_connected
    for use in (
        robot.get_observation,
        lambda: robot.send_action(dict.fromkeys(NAMES, 0.0)),
        robot.disconnect,
        hand.get_action,
        lambda: hand.send_feedback({}),
        hand.disconnect,
    ):
        with pytest.raises(NotConnectedError, match=r"call connect\(\) first"):
            use()


def test_problems_of_mmt_are_those_of_a_connection(devices, answers):
    robot = robot_of(devices)
    answers.problem = MmtError("the port is in use")
    with pytest.raises(NotConnectedError, match=r"^mmt: the port is in use$"):
        robot.connect()
    assert not robot.is_connected
    answers.problem = None
    robot.connect()
    answers.problem = DeviceLost("the follower is lost")
    with pytest.raises(NotConnectedError, match=r"^mmt: the follower is lost$"):
        robot.get_observation()
    answers.running = False
    assert not robot.is_connected
    robot.disconnect()


def test_options_and_features_are_known_before_it_is_connected(devices, answers, tmp_path):
    (tmp_path / "scene.toml").write_text("[link]\n[simulated]\n[hand]\n[force_feedback]\n")
    robot = robot_of(devices, scene=str(tmp_path / "scene.toml"))
    assert [name[:5] for name in robot.observation_features] == ["force"] * 3
    with pytest.raises(InputError, match="no such file"):
        robot_of(devices, scene="nowhere.toml")
    with pytest.raises(InputError, match='allowed is "hand", "actions"'):
        robot_of(devices, moved_by="feet")


def test_pictures_are_passed_on_and_a_camera_that_is_not_there_leaves_no_session(devices, answers):
    front, side = (SimpleNamespace(height=48, width=64, fps=fps) for fps in (30, 0))
    robot = robot_of(devices, cameras={"front": front})
    assert robot.observation_features["front"] == (48, 64, 3)
    robot.connect()
    assert [robot.get_observation()["front"] for _ in range(2)] == [1, 2]
    robot.disconnect()
    assert not robot.cameras["front"].is_connected
    robot = robot_of(devices, cameras={"front": front, "side": side})
    with pytest.raises(ConnectionError):
        robot.connect()
    assert not answers.running
    assert not robot.is_connected
    assert not robot.cameras["front"].is_connected


def test_what_is_felt_is_the_environments_state_as_well(devices):
    features = devices.pipeline_features.hw_to_dataset_features
    robot = robot_of(devices)
    found = features(robot.observation_features | {"front": (48, 64, 3)}, "observation")
    felt = [name for name in robot.observation_features if not name.startswith("position")]
    assert found["observation.environment_state"]["names"] == felt
    assert found["observation.environment_state"]["shape"] == (4,)
    assert list(found["observation.state"]["names"]) == list(robot.observation_features)
    others = features({"shoulder.pos": float, "force_z_n": float}, "observation")
    assert "observation.environment_state" not in others
    assert list(features(robot.action_features, "action")) == ["action.state"]
