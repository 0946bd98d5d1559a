"""The follower's arm through OpenHaptics HD, against the emulated library."""

import logging
import subprocess
import sys
import threading
import time

import pytest
from emulated_arm import emulated_arm
from scipy.spatial.transform import Rotation
from sensor_reading import until_turned
from waiting import until, until_lost

from mmt.core.errors import InputError, MmtError
from mmt.core.quaternions import unit_quaternion
from mmt.devices import discovery
from mmt.devices.discovery import FoundPort
from mmt.devices.openhaptics.library import Stack
from mmt.devices.openhaptics.robot import OpenHapticsRobot
from mmt.devices.reading_checks import JUMP, NOT_FINITE, OUT_OF_REACH

ENCODER_RESET, AUTO, INKWELL = 1, 2, 4
NEEDS_UPDATE, NEEDS_HANDS = 0x5001, 0x5002

emulated = emulated_arm


@pytest.fixture
def make(emulated, connected):
    """Connects a robot that has these options besides."""
    return lambda **more: connected(OpenHapticsRobot(library=emulated.address, **more))


@pytest.fixture
def robot(make):
    return make()


def distance(a, b):
    return sum((x - y) ** 2 for x, y in zip(a, b, strict=True)) ** 0.5


def test_the_arm_goes_where_it_is_told_in_the_scenes_axes(make, emulated):
    robot = make(origin_mm=(0.0, 0.0, -20.0))
    robot.calibrate()
    target = (12.0, -7.0, 4.0)
    until(lambda: distance(robot.read(), target) < 0.01, lambda: robot.write(target))
    x, y, z = emulated.tip_state().position_mm
    assert (x, y, z) == pytest.approx((12.0, -16.0, 7.0), abs=0.05)  # up is y, the user is at z


def test_the_styluss_orientation_is_in_the_scenes_axes_and_measured_when_asked_for(robot, emulated):
    assert unit_quaternion(robot.orientation()) is None  # the first call asks for it
    to_scene = Rotation.from_euler("x", 90.0, degrees=True)  # HD's y, up, is the scene's z
    for turn in Rotation.random(3, random_state=1):
        emulated.turn(turn.as_matrix().T.ravel().tolist())
        until_turned(robot, to_scene * turn)
    assert robot.faults == {}


def test_an_arm_without_commands_is_limp(robot, emulated):
    emulated.place((5.0, 0.0, 0.0))
    before = emulated.ticks
    until(lambda: emulated.ticks > before + 20)
    assert emulated.tip_state().motor_n == (0.0, 0.0, 0.0)
    assert robot.read() == pytest.approx((5.0, 0.0, 0.0))


@pytest.mark.parametrize(("limit_n", "expected_n"), [(1.0, 1.0), (3.0, 1.5)])
def test_the_force_stays_below_the_smaller_of_both_limits(make, emulated, limit_n, expected_n):
    emulated.limits(1.5, 3.5)
    emulated.hold((0.0, 0.0, 0.0), 50.0)
    robot = make(force_limit_n=limit_n)
    largest_n = 0.0

    def push():
        nonlocal largest_n
        robot.write((0.0, 0.0, -100.0))
        largest_n = max(largest_n, distance(emulated.tip_state().motor_n, (0.0, 0.0, 0.0)))

    until(lambda: largest_n > 0.99 * expected_n, push)
    before = emulated.ticks
    until(lambda: emulated.ticks > before + 50, push)
    assert largest_n == pytest.approx(expected_n, rel=1e-6)


def servo_of(arm):
    """What turns in the library's thread: no call from outside can see its turns."""
    return arm.servo


def test_the_librarys_thread_keeps_its_state_between_two_calls(robot):
    servo, kept = servo_of(robot), threading.local()

    def count():
        kept.calls = getattr(kept, "calls", 0) + 1
        return kept.calls

    for calls in range(1, 4):
        servo.run_in_frame(count)
        until(lambda: servo.request is None)
        assert servo.answer == calls


def test_its_turn_ends_with_a_tick_and_is_not_waited_for_long(robot, emulated):
    servo = servo_of(robot)
    before = servo.ticks
    robot.await_turn()
    assert servo.ticks > before
    emulated.stall()
    began = time.monotonic()
    robot.await_turn()
    assert time.monotonic() - began < 5.0


def test_stale_commands_fade_and_new_ones_do_not_throw_the_arm(make, emulated):
    robot = make(speed_limit_mm_s=50.0)
    emulated.hold((0.0, 0.0, 0.0), 5.0)
    until(lambda: emulated.tip_state().motor_n[0] > 1.0, lambda: robot.write((40.0, 0.0, 0.0)))
    until(lambda: emulated.tip_state().motor_n == (0.0, 0.0, 0.0))
    assert robot.faults == {"stale commands": 1}
    robot.write((40.0, 0.0, 0.0))
    until(lambda: emulated.tip_state().motor_n[0] > 0.0, lambda: robot.write((40.0, 0.0, 0.0)))
    assert emulated.tip_state().motor_n[0] < 0.5  # the point starts again where the tip is


def test_a_command_that_is_no_number_is_counted_and_not_obeyed(robot, emulated):
    for _ in range(20):
        robot.write((float("nan"), 0.0, 0.0))
        robot.write((0.0, float("inf"), 0.0))
    before = emulated.ticks
    until(lambda: emulated.ticks > before + 5)
    assert robot.faults == {"commands that are not finite": 40}
    assert emulated.tip_state().motor_n == (0.0, 0.0, 0.0)


def test_warm_motors_give_no_force_and_the_person_is_told_once(robot, emulated, caplog):
    with caplog.at_level(logging.WARNING):
        emulated.fail("warm")
        until(lambda: robot.faults.get("WARM_MOTORS", 0) > 5, lambda: robot.write((9.0, 0.0, 0.0)))
        robot.read()
    assert [record.message for record in caplog.records] == [
        "Emulated HD device EMULATED1: the motors are too warm and give no force "
        "(HD_WARM_MOTORS, device's own code -1): let go, let them cool for some minutes, and "
        "lower 'force_limit_n'"
    ]
    emulated.fail("warm", on=False)
    until(lambda: robot.read()[0] > 8.0, lambda: robot.write((9.0, 0.0, 0.0)))


def test_a_device_that_does_not_answer_is_lost_and_comes_back(robot, emulated):
    robot.calibrate()
    emulated.unplug()
    until_lost(robot.read, r"does not answer.*check cable")
    with pytest.raises(MmtError, match="COMM_ERROR"):
        robot.connect()
    emulated.plug()
    robot.connect()
    until(lambda: robot.read()[0] > 1.0, lambda: robot.write((2.0, 0.0, 0.0)))


def test_a_moment_without_an_answer_is_survived(robot, emulated):
    emulated.unplug()
    until(lambda: robot.faults.get("COMM_ERROR", 0) > 0)
    emulated.plug()
    before = emulated.ticks
    until(lambda: emulated.ticks > before + 1)
    until(lambda: robot.read()[0] > 1.0, lambda: robot.write((2.0, 0.0, 0.0)))


def test_flipped_bits_and_what_is_no_number_are_counted_and_move_nothing(make, emulated):
    robot = make(force_limit_n=1.0)
    emulated.fail("garbled")
    places = []

    def stroke():
        robot.write((4.0, 0.0, 0.0))
        places.append(robot.read())

    until(lambda: sum(robot.faults.values()) > 12, stroke)
    assert set(robot.faults) <= {NOT_FINITE, OUT_OF_REACH, JUMP, "stale commands"}
    assert robot.faults[NOT_FINITE] > 2
    assert max(abs(value) for place in places for value in place) < 10.0
    emulated.fail("garbled", on=False)
    until(lambda: abs(robot.read()[0] - 4.0) < 0.2, lambda: robot.write((4.0, 0.0, 0.0)))


def test_an_arm_whose_position_is_stuck_is_lost_without_force(make, emulated):
    robot = make(speed_limit_mm_s=2000.0)
    emulated.fail("stuck")
    until_lost(
        lambda: (robot.write((60.0, 0.0, 0.0)), robot.read()),
        r"the same under the largest force.*is off",
    )
    assert emulated.tip_state().motor_n == (0.0, 0.0, 0.0)
    emulated.fail("stuck", on=False)
    robot.connect()
    before = robot.read()[0]
    until(
        lambda: abs(robot.read()[0] - before) > 1.0,
        lambda: robot.write((before - 3.0, 0.0, 0.0)),
    )


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [("fault", "HD_DEVICE_FAULT"), ("stalled", "servo loop has stopped")],
)
def test_a_fault_or_a_loop_that_stands_still_is_a_loss(robot, emulated, fault, sentence):
    emulated.fail(fault)
    until_lost(robot.read, sentence)
    emulated.fail(fault, on=False)
    robot.connect()
    assert robot.read() == pytest.approx((0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [("absent", "is not there.*its power, its cable"), ("unlicensed", "licence is missing")],
)
def test_a_device_that_cannot_be_opened_says_why(make, emulated, fault, sentence):
    emulated.fail(fault)
    with pytest.raises(MmtError, match=sentence):
        make()


def test_ports_that_the_person_may_not_open_are_named(make, emulated, monkeypatch):
    found = [
        FoundPort("/dev/ttyACM7", "Touch", "", "no permission for /dev/ttyACM7: ask"),
        FoundPort("/dev/ttyS0", "", "", ""),
    ]
    monkeypatch.setattr(discovery, "find_serial_ports", lambda: found)
    emulated.fail("absent")
    with pytest.raises(MmtError, match=r"then connect again; no permission for /dev/ttyACM7: ask$"):
        make()


def test_a_library_that_may_not_be_read_is_told_from_one_that_is_no_library(tmp_path, monkeypatch):
    library = tmp_path / "libHD.so"
    library.write_text("no library")
    monkeypatch.setattr("os.access", lambda _path, _mode: False)
    with pytest.raises(InputError, match="you may not read it: ask its owner"):
        Stack(str(library))


def test_a_servo_loop_that_stands_still_does_not_hold_up_the_calibration(robot, emulated):
    emulated.stall()
    until_lost(robot.calibrate, "servo loop has stopped")  # the loop may have had a last tick


def test_two_devices_share_the_stack_and_one_name_is_used_once(make, emulated):
    first, second = make(device="Left"), make(device="Right")
    emulated.place((3.0, 0.0, 0.0), device=1)
    until(lambda: second.read()[0] == pytest.approx(3.0))
    with pytest.raises(MmtError, match="in use already"):
        make(device="Left")
    first.close()
    until(lambda: second.read()[0] > 4.0, lambda: second.write((5.0, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("styles", "status", "sentence"),
    [
        (AUTO, NEEDS_HANDS, "move the tip slowly"),
        (INKWELL, NEEDS_HANDS, "put the stylus into the inkwell"),
        (ENCODER_RESET, NEEDS_HANDS, "reset_encoders = true"),
    ],
)
def test_a_calibration_that_needs_hands_says_what_to_do(make, emulated, styles, status, sentence):
    robot = make(calibration_s=0.0)
    emulated.uncalibrate(styles, status)
    with pytest.raises(MmtError, match=sentence):
        robot.calibrate()


def test_a_calibration_that_is_due_is_updated(make, robot, emulated, caplog):
    emulated.uncalibrate(AUTO | INKWELL, NEEDS_UPDATE)
    robot.calibrate()
    until(lambda: robot.read()[0] > 100.0)  # the zero is another one, and nothing has jumped
    assert robot.faults == {}  # it has kept to one frame a tick
    emulated.uncalibrate(ENCODER_RESET, NEEDS_HANDS)
    with pytest.raises(MmtError, match="reset position"):
        make_again(robot, emulated)
    reset = make(reset_encoders=True)
    reset.calibrate()
    emulated.uncalibrate(ENCODER_RESET, NEEDS_HANDS)
    with pytest.raises(MmtError, match="reset position"):  # where it stands now is no zero
        make_again(reset, emulated)
    emulated.uncalibrate(0, NEEDS_HANDS)
    reset.connect()
    reset.calibrate()  # a device without calibration needs none


def make_again(robot, emulated):
    """Connect a device that had been calibrated."""
    robot.close()
    robot.connect()


def test_a_stiffness_beyond_the_device_is_refused(make, emulated):
    emulated.limits(8.5, 0.4)
    with pytest.raises(InputError, match=r"at most 0\.4"):
        make()


@pytest.mark.parametrize("force_n", [0.0, float("nan")])
def test_a_device_that_knows_no_limit_of_its_force_is_refused(make, emulated, force_n):
    emulated.limits(force_n, 3.5)
    with pytest.raises(MmtError, match="no limit is known"):
        make()


def run_alone(program):
    """Run a program in a process of its own, for the libraries that a process has."""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    return done.stdout


PROGRAM = """
import sys
from mmt.devices.openhaptics.library import Stack
from mmt.devices.reading_checks import JUMP, NOT_FINITE, OUT_OF_REACH
from mmt.devices.openhaptics.robot import OpenHapticsRobot
from mmt.core.errors import MmtError
for library in {libraries!r}:
    try:
        OpenHapticsRobot(library=library).connect()
    except MmtError as error:
        print(error)
"""


def test_a_library_that_cannot_be_loaded_says_what_to_do(tmp_path, emulated):
    other = tmp_path / "libHD.so"
    other.write_text("no library")
    libraries = [str(tmp_path / "none.so"), "libnowhere.so", "libm.so.6", str(other)]
    lines = run_alone(PROGRAM.format(libraries=libraries)).splitlines()
    assert "there is no such file: install" in lines[0]
    assert "give the library's path" in lines[1]
    assert "is no OpenHaptics HD library" in lines[2]
    assert "cannot be loaded" in lines[3]


def test_a_process_has_one_driver_stack(emulated, tmp_path):
    program = PROGRAM.format(libraries=["emulated", "/usr/lib/libHD.so"])
    assert "must be driven by another process" in run_alone(program)


def test_a_process_that_ends_without_closing_leaves_no_thread_behind(emulated):
    program = PROGRAM.format(libraries=["emulated"]) + "\nprint('end')"
    assert run_alone(program) == "end\n"
