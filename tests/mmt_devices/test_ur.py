"""Robot and force sensor of Universal Robots, by the real ur_rtde, on an emulated controller."""

import itertools
import math
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from running_source import RunningSource
from scipy.spatial.transform import Rotation
from sensor_reading import until_turned
from waiting import check_refused, children, until, until_lost

from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.devices.drivers import load_device
from mmt.testing.emulated import drivers as lab_drivers
from mmt_devices.universal_robots.emulated.arm import PLAYING, POWER_OFF, STOPPED
from mmt_devices.universal_robots.emulated.controller import EmulatedUrController
from mmt_devices.universal_robots.link import ArmLink

if find_spec("rtde_control") is None:
    pytest.skip("ur-rtde is not installed (pip install ur-rtde)", allow_module_level=True)
if sys.platform != "linux":
    pytest.skip("loopback addresses of one's own are for Linux", allow_module_level=True)

TOOL_DOWN = (2.2, 2.2, 0.0)


class Spring:
    """A tip that is where it is told, on a surface of 2 N/mm."""

    command_mm: tuple[float, float, float] | None = None

    def position_mm(self, time_ns):
        return self.command_mm or (0.0, 0.0, 5.0)

    def force_n(self, time_ns):
        return (0.0, 0.0, max(0.0, -2.0 * self.position_mm(time_ns)[2]))


class Lab:
    """An emulated controller, and the drivers of its arm."""

    def __init__(self):
        self.tip = Spring()
        self.controller = EmulatedUrController(self.tip)
        self.controller.start()
        self.arm = self.controller.arm
        self.robot = self.make("robot")
        self.force = self.make("force_sensor")

    def make(self, role, **options):
        given = self.controller.options
        if role == "robot":
            given |= {"speed_limit_mm_s": 1000, "acceleration_limit_mm_s2": 20_000}
        else:
            del given["origin_mm"]
        return load_device("ur", {**given, **options}, role=role)

    def connect_again(self):
        """Connect the robot once its old control is gone."""
        self.robot.close()
        until(lambda: not self.controller.connections)
        self.robot.connect()

    def go(self, position_mm):
        self.robot.write(position_mm)
        until(lambda: self.robot.read() == pytest.approx(position_mm, abs=0.1))


@pytest.fixture
def lab():
    made = Lab()
    yield made
    made.robot.close()
    made.force.close()
    made.controller.stop()
    assert children("universal_robots") == []


def test_the_arm_follows_commands_with_its_tool_as_it_was_and_feels_the_surface(lab):
    lab.robot.connect()
    lab.force.connect()
    lab.force.calibrate()
    assert lab.robot.read() == pytest.approx((0.0, 0.0, 5.0))
    assert lab.tip.command_mm is None  # nothing moves before the first command
    lab.go((10.0, -4.0, 1.0))
    lab.go((20.0, 8.0, -2.0))
    base_to_scene = Rotation.from_rotvec(lab.controller.options["rotation_rad"]).inv()
    until_turned(lab.robot, base_to_scene * Rotation.from_rotvec(TOOL_DOWN))
    assert lab.tip.position_mm(0) == pytest.approx((20.0, 8.0, -2.0), abs=0.1)
    until(lambda: lab.force.read() == pytest.approx((0.0, 0.0, 4.0), abs=0.3))
    assert lab.arm.rotation_rad == pytest.approx(TOOL_DOWN)
    lab.robot.close()
    lab.robot.close()
    until(lambda: lab.arm.runtime_state == STOPPED)
    assert lab.force.read()[2] == pytest.approx(4.0, abs=0.5)
    lab.tip.command_mm = (0.0, 0.0, -6.0)  # pressed, it is not taken again until it is free
    check_refused(lab.robot.connect, "feels 12 N, and the arm zeroes its force sensor when")
    lab.tip.command_mm = None
    lab.robot.connect()
    assert lab.robot.read() == pytest.approx((0.0, 0.0, 5.0))


def test_robot_and_force_sensor_come_and_go_by_themselves_but_must_agree(lab):
    lab.force.connect()
    for _ in range(2):
        lab.robot.connect()
        lab.force.read()
        lab.robot.close()
        lab.force.read()
    lab.robot.connect()
    lab.force.close()
    lab.robot.read()
    lab.force.connect()
    assert len(children("universal_robots")) == 2
    with pytest.raises(InputError, match=r"one has rotation_rad.*give both the same"):
        lab.make("force_sensor", rotation_rad=[0, 0, 1]).connect()
    check_refused(lab.make("robot").connect, "robot of two drivers", InputError)
    assert lab.robot.read() == pytest.approx((0.0, 0.0, 5.0))


def test_the_bias_is_taken_off_at_rest_alone_and_stays_in_the_next_connection(
    lab, monkeypatch, caplog
):
    lab.tip.command_mm = (0.0, 0.0, -1.0)
    lab.force.connect()
    read, turn = ArmLink.read, itertools.count()

    def broken(link):
        state = read(link)
        return state if next(turn) % 5 else state._replace(force_n=(0.0, math.nan, 0.0))

    with monkeypatch.context() as patch:  # forces that are not finite do not count
        patch.setattr(ArmLink, "read", broken)
        lab.force.calibrate()
    assert lab.force.read() == pytest.approx((0.0, 0.0, 0.0), abs=0.3)
    lab.tip.command_mm = (0.0, 0.0, -3.0)
    lab.force.close()
    assert not caplog.messages
    lab.force.connect()
    assert "is connected again: if its program has started meanwhile" in caplog.text
    until(lambda: lab.force.read() == pytest.approx((0.0, 0.0, 4.0), abs=0.3))
    lab.arm.noise_n = 5.0
    check_refused(lab.force.calibrate, "moves while its bias is taken")


FAULTS = [
    (lambda lab: lab.arm.protective_stop(), "in a protective stop: the pendant shows why"),
    (lambda lab: lab.arm.emergency_stop(), "release the red button"),
    (lambda lab: lab.controller.switch_to_local(), "not in remote control: switch it from Local"),
    (lambda lab: setattr(lab.arm, "mode", POWER_OFF), r"not running \(the pendant shows POWER_OFF"),
]
"""What may happen to an arm, and what is told while it is read and as it is connected again."""


def test_a_lost_arm_says_why_and_what_to_do_and_comes_back(lab):
    lab.robot.connect()
    lab.go((5.0, 0.0, 4.0))
    for begin, told in FAULTS:
        begin(lab)
        until_lost(lab.robot.read, told)
        with pytest.raises(DeviceLost):
            lab.robot.write((0.0, 0.0, 0.0))
        lab.robot.close()
        check_refused(lab.robot.connect, told)
        lab.arm.restore()
        lab.controller.remote = True
        lab.connect_again()
        assert lab.robot.read() == pytest.approx((5.0, 0.0, 4.0), abs=0.2)
    lab.controller.unplug()
    until_lost(lab.robot.read, "sends nothing any more|takes no commands any more|has ended, as th")
    lab.robot.close()
    check_refused(lab.robot.connect, "no UR controller answers")
    lab.controller.plug()
    lab.connect_again()
    lab.go((0.0, 5.0, 6.0))
    lab.arm.end_program()
    until_lost(lab.robot.read, "Stop was pressed at the pendant")
    lab.connect_again()
    lab.arm.protective_stop()  # of an arm that is commanded and never read
    until_lost(lambda: lab.robot.write((0.0, 0.0, 5.0)), "in a protective stop")
    lab.arm.restore()
    lab.connect_again()
    lab.arm.stuck = True  # its pose stays where it is
    lab.robot.write((50.0, 0.0, 5.0))
    until_lost(lab.robot.read, "does not follow: its tip stays")


def test_a_force_that_is_stuck_or_silent_stays_lost_until_it_changes(lab):
    force = lab.force = lab.make("force_sensor", stuck_ms=100)
    force.connect()
    lab.arm.stuck = True
    until_lost(force.read, "very same values for 100 ms")
    check_refused(force.connect, "very same values")
    lab.arm.stuck = False
    force.connect()
    force.read()
    lab.controller.silent = True
    until_lost(force.read, "sends nothing any more")
    lab.controller.silent = False
    force.connect()
    assert force.read() == pytest.approx((0.0, 0.0, 0.0), abs=0.5)
    force.close()
    lab.controller.refuses_version = True
    check_refused(force.connect, r"gives no data by RTDE.*software is 3\.4 or later")


def test_a_process_that_dies_leaves_an_arm_that_its_watchdog_stops(lab):
    lab.robot.connect()
    lab.go((5.0, 0.0, 4.0))
    children("universal_robots")[0].kill()
    until_lost(lab.robot.read, "has ended")
    until(lambda: lab.arm.runtime_state == STOPPED)
    lab.robot.close()
    lab.robot.connect()
    lab.go((0.0, 0.0, 6.0))


def test_a_process_that_stands_still_holds_up_no_call(lab):
    lab.robot.connect()
    (process,) = children("universal_robots")
    process.suspend()
    for tick in range(5000):  # more than the pipe holds
        lab.robot.write((0.001 * tick, 0.0, 5.0))
    until_lost(lab.robot.read, "nothing has come from the UR arm")
    process.kill()


def test_commands_are_cut_to_the_box_and_the_force_and_those_that_are_no_numbers_counted(lab):
    box = {"least_mm": [-5, -5, -20], "most_mm": [5, 5, 0]}
    lab.robot = lab.make("robot", **box, force_limit_n=6.0, speed_limit_mm_s=20)
    lab.robot.connect()
    lab.robot.write((0.0, 0.0, -20.0))
    held_back = "periods held back by force_limit_n"
    until(lambda: lab.robot.faults.get(held_back, 0) > 50, lab.robot.read)
    assert -3.0 >= lab.robot.read()[2] > -6.0  # 2 N/mm, and a little more for the servo's lag
    lab.robot.write((30.0, 0.0, 20.0))
    until(lambda: lab.robot.read() == pytest.approx((5.0, 0.0, 0.0), abs=0.01))
    lab.robot.write((float("nan"), 0.0, 5.0))
    assert lab.robot.faults["commands outside of least_mm and most_mm"] == 1
    assert lab.robot.faults["commands that are not finite"] == 1


def test_without_an_origin_the_scene_begins_where_the_tip_is(lab, monkeypatch):
    robot = lab.robot = lab.make("robot", origin_mm=None)

    def lose(_):
        raise DeviceLost("gone")

    with monkeypatch.context() as patched:  # lost while the origin is read
        patched.setattr(ArmLink, "read", lose)
        with pytest.raises(DeviceLost, match="gone"):
            robot.connect()
    robot.connect()
    assert robot.read() == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    lab.go((3.0, 0.0, 2.0))
    robot.close()
    robot.connect()  # its zero is not taken anew
    assert robot.read() == pytest.approx((3.0, 0.0, 2.0), abs=0.2)


def test_what_is_not_connected_is_lost_and_what_is_not_installed_is_told(lab):
    for device in (lab.robot, lab.force):
        check_refused(device.read, "connect it first", DeviceLost)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "rtde_control", None)
        for driver in ("ur", "virtual-ur"):
            options = {} if driver == "virtual-ur" else {"host": lab.controller.host}
            with pytest.raises(InputError, match=r"need ur-rtde, which is not installed.*\[ur\]"):
                load_device(driver, options)
    with pytest.raises(InputError, match=r"^virtual-ur: device 'ur': foo is not a key; allowed"):
        load_device("virtual-ur", {"foo": 1})


def test_frames_go_on_after_a_protective_stop_though_the_force_is_zeroed_in_contact(lab, started):
    running = started(RunningSource(lab.force, None, lab.robot))
    running.command_mm = (5.0, 0.0, -1.0)
    frames = running.run(lambda number: number >= 250)
    assert frames["position_mm"][-1] == pytest.approx((5.0, 0.0, -1.0), abs=0.1)
    assert frames["force_n"][-1] == pytest.approx((0.0, 0.0, 2.0), abs=0.5)
    lab.arm.protective_stop()
    running.run(lambda _: running.is_lost)
    turns = itertools.count()
    assert len(running.run(lambda _: next(turns) > 50)) == 0
    lab.arm.restore()
    running.run(lambda _: not running.is_lost)
    frames = running.run(lambda number: number >= 300)
    assert frames["position_mm"][-1] == pytest.approx((5.0, 0.0, -1.0), abs=0.1)
    np.testing.assert_allclose(frames["force_n"][:, 2], 2.0, atol=0.5)
    assert lab.arm.runtime_state == PLAYING
    assert [sentence for _, sentence in running.told if "force" in sentence] == []


def test_a_virtual_arm_beside_another_robot_is_refused():
    robot = load_device("virtual-robot")
    try:
        robot.connect()
        with pytest.raises(MmtError, match="has another robot already"):
            load_device("virtual-ur", role="force_sensor").connect()
        assert robot.read()
    finally:
        robot.close()
    assert lab_drivers.LAB.process is None
