"""The Franka drivers' own logic, on a stand-in for the library and the arm."""

import itertools
import math
import threading
import time

import pytest
from running_source import RunningSource
from scipy.spatial.transform import Rotation
from sensor_reading import until_turned
from waiting import PATIENCE_S, check_refused, until, until_lost

from mmt.core.errors import DeviceLost, InputError
from mmt.core.extras import require
from mmt.devices.drivers import load_device
from mmt_devices.franka import arm as arms
from mmt_devices.franka import driver as franka_driver
from mmt_devices.franka.driver import FrankaForce, FrankaRobot
from mmt_devices.franka.emulated import EmulatedFranka, RealtimeConfig, RobotMode, TorqueStopMotion

REFLEX = 'libfranka: Move command aborted: motion aborted by reflex! ["cartesian_reflex"]'
USER_STOP = "libfranka: Move command aborted: User Stop pressed!"
HOME = (500.0, 0.0, 300.0)


@pytest.fixture
def emulated():
    arm = EmulatedFranka()
    with arm.library():
        yield arm
        until(lambda: arm.connections == 0)


@pytest.fixture
def make(emulated, closing):
    """Makes a driver of the emulated arm that has these options besides."""
    return lambda kind=FrankaRobot, **more: closing(kind(kind.OPTIONS(host="arm", **more)))


@pytest.fixture
def robot(make, connected):
    return connected(make())


def moved(x_mm):
    return (HOME[0] + x_mm, *HOME[1:])


def near(robot, target, mm=0.05):
    return math.dist(robot.read(), target) < mm


def test_without_fit_commands_nothing_moves(robot, emulated):
    turns = robot.arm.turns
    until(lambda: robot.arm.turns > turns + 20)
    for _ in range(20):
        robot.write((math.nan, 0.0, 0.0))
        robot.write((0.0, math.inf, 0.0))
    turns = robot.arm.turns
    until(lambda: robot.arm.turns > turns + 5)
    assert robot.faults == {"commands that are not finite": 40}
    assert emulated.motions == []
    assert robot.read() == pytest.approx(HOME)


def test_the_arm_goes_where_it_is_told_and_its_tool_turns_in_the_scenes_axes(
    make, connected, emulated
):
    robot = connected(make(axes="-y,x,z", origin_mm=(0.0, 500.0, 200.0)))
    robot.calibrate()
    assert robot.read() == pytest.approx((0.0, 0.0, 100.0))
    target = (12.0, -7.0, 96.0)
    until(lambda: near(robot, target), lambda: robot.write(target))
    assert emulated.position_m == pytest.approx([0.493, -0.012, 0.296], abs=1e-4)
    assert robot.faults == {}
    quarter = Rotation.from_euler("z", 90.0, degrees=True)  # the scene's x is the base's -y
    for turn in Rotation.random(3, random_state=1):
        emulated.rotation = turn.as_quat()
        until_turned(robot, quarter * turn)


def test_options_reach_the_arm(make, connected, emulated):
    stiffness = {"stiffness_n_mm": 2.0, "rotational_stiffness_nm_rad": 30.0}
    limits = {"force_limit_n": 10.0, "collision_force_n": 25.0, "collision_torque_nm": 15.0}
    robot = make(realtime="ignore", posture_stiffness_nm_rad=5.0, **stiffness, **limits)
    connected(robot)
    until(lambda: bool(emulated.motions), lambda: robot.write(HOME))
    (motion,) = emulated.motions
    assert motion.translational_stiffness == 2000.0
    assert motion.rotational_stiffness == 30.0
    assert motion.translational_error_clip == [0.005] * 3
    assert motion.posture_task.stiffness == 5.0
    assert motion.posture_task.target[3] == -1.6
    assert emulated.collisions == (15.0, 25.0)
    assert emulated.realtime is RealtimeConfig.Ignore


def test_a_far_command_is_approached_at_the_speed_limit(make, connected, emulated):
    robot = connected(make(speed_limit_mm_s=50.0))
    began = time.monotonic()
    until(lambda: bool(emulated.motions), lambda: robot.write(moved(400.0)))
    (motion,) = emulated.motions
    until(lambda: motion.reference.target.translation[0] > 0.505)
    reached_mm = 1e3 * (motion.reference.target.translation[0] - 0.5)
    assert reached_mm <= 50.0 * (time.monotonic() - began) + 0.01
    assert motion.reference.target_twist.linear_velocity[0] <= 0.05 + 1e-9
    until(lambda: motion.reference.target_twist.linear_velocity[0] > 0.04)


def test_no_call_waits_for_the_arm(make, connected, emulated):
    robot, force = connected(make()), connected(make(FrankaForce))
    until(lambda: bool(emulated.motions), lambda: robot.write(HOME))

    def tick():
        for _ in range(200):
            robot.write(HOME)
            robot.read()
            force.read()

    with emulated.lock:  # whoever asks the arm for anything waits
        ticking = threading.Thread(target=tick)
        ticking.start()
        ticking.join(PATIENCE_S)
        assert not ticking.is_alive()


@pytest.mark.parametrize(
    ("why", "mode", "sentence"),
    [
        ("cartesian_reflex", RobotMode.Reflex, "beyond 'collision_force_n'"),
        ("joint_reflex", RobotMode.Reflex, "'collision_torque_nm'"),
        ("power_limit_violation", RobotMode.Reflex, "power_limit_violation"),
        (
            "communication_constraints_violation",
            RobotMode.Reflex,
            "commands came too late: use a kernel with PREEMPT_RT",
        ),
        (USER_STOP, RobotMode.UserStopped, "its user stop is pressed: see that nobody"),
        ("libfranka: something new", RobotMode.Idle, "the library reports: something new"),
    ],
)
def test_a_stop_while_it_moves_is_a_loss_that_says_why(robot, emulated, why, mode, sentence):
    until(lambda: bool(emulated.motions), lambda: robot.write(HOME))
    reflex = mode is RobotMode.Reflex
    emulated.stop(REFLEX.replace("cartesian_reflex", why) if reflex else why, mode)
    until_lost(robot.read, sentence)
    check_refused(lambda: robot.write(HOME), "Franka arm arm", DeviceLost)


def test_a_reflex_is_recovered_on_connecting_and_nothing_moves_until_a_command(
    robot, emulated, caplog
):
    until(lambda: near(robot, moved(5.0)), lambda: robot.write(moved(5.0)))
    emulated.stop(REFLEX, error="cartesian_reflex")
    until_lost(robot.read, "beyond 'collision_force_n'")
    emulated.recoverable = False
    robot.close()
    check_refused(robot.connect, r"cannot be recovered from .*cartesian_reflex")
    emulated.recoverable = True
    robot.connect()
    assert "was recovered from ['cartesian_reflex']" in caplog.text
    begun = len(emulated.motions)
    turns = robot.arm.turns
    until(lambda: robot.arm.turns > turns + 20)
    assert len(emulated.motions) == begun
    assert near(robot, moved(5.0))
    until(lambda: near(robot, moved(8.0)), lambda: robot.write(moved(8.0)))
    robot.close()  # which brings a moving arm to rest, and gives the connection back
    robot.close()
    assert isinstance(emulated.motions[-1], TorqueStopMotion)
    assert (emulated.moving, emulated.connections) == (False, 0)
    check_refused(robot.read, "not connected", DeviceLost)


@pytest.mark.parametrize(
    ("state", "value", "told", "refused"),
    [
        ("mode", RobotMode.UserStopped, "user stop is pressed", "user stop is pressed"),
        ("mode", RobotMode.Guiding, "guided by hand", "guided by hand"),
        ("mode", RobotMode.Other, "activate FCI in Desk", "activate FCI in Desk"),
        ("powered", False, "does not answer: check its power and its c", "takes no connection: c"),
        ("answering", False, "sends no new state", ""),
    ],
)
def test_an_arm_in_no_state_to_be_used_is_refused_or_lost_until_it_is(
    robot, emulated, state, value, told, refused
):
    usual = getattr(emulated, state)
    until(lambda: bool(emulated.motions), lambda: robot.write(HOME))
    setattr(emulated, state, value)
    until_lost(robot.read, told)
    robot.close()
    if refused:
        check_refused(robot.connect, refused)
    assert emulated.recoveries == 0  # for these a person has to do something
    setattr(emulated, state, usual)
    robot.connect()
    assert robot.read() == pytest.approx(HOME)


def test_a_library_that_does_not_return_is_a_loss_and_not_called_twice(make, emulated, monkeypatch):
    monkeypatch.setattr(arms, "_CONNECT_S", 0.05)
    robot = make()
    with emulated.lock:
        for _ in range(3):
            check_refused(robot.connect, "takes the connection but does not answer")
        names = [each.name for each in threading.enumerate()]
        assert names.count("Franka arm arm") == 1
    monkeypatch.setattr(arms, "_CONNECT_S", 10.0)
    until(lambda: emulated.connections == 0)
    robot.connect()
    assert robot.read() == pytest.approx(HOME)
    monkeypatch.setattr(arms, "_STUCK_NS", 50_000_000)
    monkeypatch.setattr(arms, "_END_S", 0.05)
    with emulated.lock:
        until_lost(robot.read, "does not answer")
    robot.close()


def test_arm_and_force_sensor_share_a_connection(make, connected, emulated):
    force = connected(make(FrankaForce, axes="-y,x,z"))
    robot = connected(make())
    assert emulated.connections == 1
    emulated.pushes_n = (1.0, 0.5, -3.0)  # down, on what is below it
    until(lambda: force.read() == pytest.approx((0.5, -1.0, 3.0)))
    until(lambda: bool(emulated.motions), lambda: robot.write(HOME))
    robot.close()
    assert not emulated.moving
    assert force.read() == pytest.approx((0.5, -1.0, 3.0))
    robot.connect()
    until(lambda: len(emulated.motions) == 3, lambda: robot.write(HOME))


def test_the_bias_is_of_finite_forces_at_rest_and_without_them_the_arm_is_lost(
    make, connected, emulated, monkeypatch
):
    force, number = connected(make(FrankaForce)), itertools.count()
    forces = itertools.cycle([(0.5, -1.0, 3.0), (math.nan, 0.0, 0.0)])
    emulated.pushes_n = (-1.0, 0.5, -2.0)
    check = arms.FrankaArm.check

    def measured(arm):
        return check(arm)._replace(time_ms=next(number), force_n=next(forces))

    with monkeypatch.context() as patch:
        patch.setattr(arms.FrankaArm, "check", measured)
        force.calibrate()
    until(lambda: force.read() == pytest.approx((0.5, 0.5, -1.0)))
    assert force.faults == {}
    emulated.pushes_n = (0.0, 0.0, 0.0)  # none at all
    until(lambda: bool(force.faults), force.read)
    assert "singularity" in next(iter(force.faults))
    assert force.read() == (0.0, 0.0, 0.0)  # and not minus the bias
    monkeypatch.setattr(arms.FrankaArm, "check", measured)
    forces = itertools.repeat((0.0, math.inf, 0.0))
    monkeypatch.setattr(franka_driver, "_BIAS_PATIENCE_S", 0.05)
    check_refused(force.calibrate, "gave 0 finite forces", DeviceLost)


def test_what_cannot_be_connected_is_refused(make, monkeypatch):
    first, second = make(), make()
    first.connect()
    check_refused(second.connect, "driven already", InputError)
    check_refused(make(FrankaForce, realtime="ignore").connect, "differ in 'realtime'", InputError)
    assert first.read() == pytest.approx(HOME)
    monkeypatch.setattr("mmt.core.extras.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"franky-control .*which is not installed; .*\[franka\]"):
        require("franky")
    with pytest.raises(InputError, match="franky-control"):
        load_device("franka", {"host": "arm"})
    assert "pip install" in franka_driver.missing()


def test_a_session_goes_on_after_a_reflex(make, emulated, started):
    """Both devices are lost at once, and connected again side by side."""
    emulated.pushes_n = (0.0, 0.0, 0.1)
    running = started(RunningSource(make(FrankaForce), None, make()))
    running.run(lambda number: number >= 50)
    emulated.stop(REFLEX, error="cartesian_reflex")
    running.run_until_told("robot .*is lost", "force sensor .*is lost")
    running.run(lambda _: not running.is_lost)
    frames = running.run(lambda number: number >= 50)
    assert frames["position_mm"][-1] == pytest.approx(HOME, abs=0.1)
    assert emulated.connections == 1
