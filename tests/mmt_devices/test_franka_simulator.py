"""The Franka drivers through the real library, against a simulator of the robot's protocol."""

import math
import os
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from franka_simulator import simulated_arm
from waiting import check_refused, until, until_lost

from mmt.devices.drivers import load_device
from mmt_devices.franka.control import PositionControl
from mmt_devices.franka.options import FrankaRobotOptions

franky = pytest.importorskip(
    "franky", reason="franky-control is not installed: see docs/how-to/franka.md"
)


@pytest.fixture
def simulated():
    """At an address of its own, since the port is the protocol's."""
    number = os.getpid()
    with simulated_arm(f"127.{1 + number // 65536 % 250}.{number // 256 % 256}.7") as arm:
        yield arm


def test_the_library_has_what_the_driver_calls():
    class State:
        q = np.zeros(7)
        O_T_EE = franky.Affine([0.5, 0.0, 0.3])

    class Robot:
        is_in_control = True
        motion: Any = None

        def set_collision_behavior(self, torque_nm, force_n):
            """Take them."""

        def move(self, motion, *, asynchronous):
            assert asynchronous
            self.motion = motion

    robot, control = (
        Robot(),
        PositionControl(franky, FrankaRobotOptions(host="arm", force_limit_n=10.0)),
    )
    control.target_mm = (510.0, 0.0, 300.0)
    control.step(robot, State(), 0)
    control.step(robot, State(), 4_000_000)
    reference = robot.motion.get_reference()
    assert reference.target.translation == pytest.approx([0.501, 0.0, 0.3])
    assert reference.target_twist.linear == pytest.approx([0.25 * 4 / 14, 0.0, 0.0])
    assert robot.motion.params.translational_error_clip == pytest.approx([0.01] * 3)
    control.left = True
    control.step(robot, State(), 5_000_000)
    assert isinstance(robot.motion, franky.TorqueStopMotion)
    for name in ("state", "has_errors", "recover_from_errors", "is_in_control", "join_motion"):
        assert hasattr(franky.Robot, name)
    for name in ("Idle", "Other", "Guiding", "Reflex", "UserStopped"):
        assert getattr(franky.RobotMode, name).name == name


@pytest.mark.skipif(
    find_spec("franky_sim") is None,
    reason="franky-sim, with MuJoCo, is not installed: see docs/how-to/franka.md",
)
def test_the_simulated_arm_moves_and_its_reflex_user_stop_and_lost_power_are_survived(
    simulated, connected
):
    options = {"host": simulated.host, "realtime": "ignore"}
    robot = connected(load_device("franka", {**options, "stiffness_n_mm": 3.0}, role="robot"))
    force = connected(load_device("franka", options, role="force_sensor"))
    force.calibrate()
    x, y, z = robot.read()
    target = (x + 20.0, y, z - 10.0)
    until(lambda: math.dist(robot.read(), target) < 3.0, lambda: robot.write(target))  # friction
    for fault, told in (
        ("reflex", r"beyond 'collision_force_n'.*cartesian_reflex"),
        ("user-stop", r"user stop is pressed.*User Stop pressed!"),
        ("power", "sends no new state|does not answer"),
    ):
        turns = robot.arm.turns
        until(lambda turns=turns: robot.arm.turns > turns + 20, lambda: robot.write(robot.read()))
        simulated.kill() if fault == "power" else simulated.tell(fault)
        until_lost(lambda: robot.write(robot.read()), told)
        if fault != "reflex":
            check_refused(robot.connect, r"user stop is pressed|takes no connection")
            simulated.start() if fault == "power" else simulated.tell("release")
        robot.connect()
        force.connect()
    assert force.read() == (0.0, 0.0, 0.0)
