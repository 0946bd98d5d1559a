"""Arm and handle through OpenHaptics HD, against the emulated library."""

import logging
import math
import sys
import threading
import time

import pytest
from emulated_arm import emulated_arm
from python_programs import printed_by
from scipy.spatial.transform import Rotation
from sensor_reading import until_turned
from waiting import check_refused, until, until_lost

from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.core.quaternions import unit_quaternion
from mmt.devices import discovery
from mmt.devices.discovery import FoundPort
from mmt.devices.drivers import load_device
from mmt.devices.openhaptics.library import Stack
from mmt.devices.reading_checks import JUMP, NOT_FINITE, OUT_OF_REACH

ENCODER_RESET, AUTO, INKWELL = 1, 2, 4
NEEDS_UPDATE, NEEDS_HANDS = 0x5001, 0x5002

emulated = emulated_arm


@pytest.fixture
def make(emulated, connected):
    """Connects a robot that has these options besides."""
    options = {"library": emulated.address}
    return lambda **more: connected(load_device("openhaptics", {**options, **more}, role="robot"))


@pytest.fixture
def robot(make):
    return make()


def test_the_arm_goes_where_it_is_told_in_the_scenes_axes(make, emulated):
    robot = make(origin_mm=(0.0, 0.0, -20.0))
    robot.calibrate()
    target = (12.0, -7.0, 4.0)
    until(lambda: math.dist(robot.read(), target) < 0.01, lambda: robot.write(target))
    x, y, z = emulated.tip_state().position_mm
    assert (x, y, z) == pytest.approx((12.0, -16.0, 7.0), abs=0.05)  # up is y, the user is at z


def test_the_styluss_orientation_is_in_the_scenes_axes_and_measured_when_asked_for(robot, emulated):
    assert unit_quaternion(robot.orientation()) is None  # the first call asks for it
    to_scene = Rotation.from_euler("x", 90.0, degrees=True)  # HD's y, up, is the scene's z
    for turn in Rotation.random(3, random_state=1):
        emulated.turn(turn.as_matrix().T.ravel().tolist())
        until_turned(robot, to_scene * turn)
    assert robot.faults == {}


def test_an_arm_without_commands_or_with_such_as_are_no_numbers_is_limp(robot, emulated):
    emulated.place((5.0, 0.0, 0.0))
    for _ in range(20):
        before = emulated.ticks
        until(lambda before=before: emulated.ticks > before)
        assert emulated.tip_state().motor_n == (0.0, 0.0, 0.0)
    assert robot.read() == pytest.approx((5.0, 0.0, 0.0))
    for _ in range(20):
        robot.write((float("nan"), 0.0, 0.0))
        robot.write((0.0, float("inf"), 0.0))
    before = emulated.ticks
    until(lambda: emulated.ticks > before + 5)
    assert robot.faults == {"commands that are not finite": 40}
    assert emulated.tip_state().motor_n == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("limit_n", "expected_n"), [(1.0, 1.0), (3.0, 1.5)])
def test_the_force_stays_below_the_smaller_of_both_limits(make, emulated, limit_n, expected_n):
    emulated.limits(1.5, 3.5)
    emulated.hold((0.0, 0.0, 0.0), 50.0)
    robot = make(force_limit_n=limit_n)
    largest_n = 0.0

    def push():
        nonlocal largest_n
        robot.write((0.0, 0.0, -100.0))
        largest_n = max(largest_n, math.hypot(*emulated.tip_state().motor_n))

    until(lambda: largest_n > 0.99 * expected_n, push)
    before = emulated.ticks
    until(lambda: emulated.ticks > before + 50, push)
    assert largest_n == pytest.approx(expected_n, rel=1e-6)


def test_the_librarys_thread_keeps_its_state_between_two_calls(robot):
    servo, kept = robot.servo, threading.local()

    def count():
        kept.calls = getattr(kept, "calls", 0) + 1
        return kept.calls

    for calls in range(1, 4):
        servo.run_in_frame(count)
        until(lambda: servo.request is None)
        assert servo.answer == calls


def test_its_turn_ends_with_a_tick_and_is_not_waited_for_long(robot, emulated):
    servo = robot.servo
    before = servo.ticks
    robot.await_turn()
    assert servo.ticks > before
    emulated.stall()
    began = time.monotonic()
    robot.await_turn()
    assert time.monotonic() - began < 5.0
    until_lost(robot.calibrate, "servo loop has stopped")  # the loop may have had a last tick


def test_stale_commands_fade_and_new_ones_do_not_throw_the_arm(make, emulated):
    robot = make(speed_limit_mm_s=50.0)
    emulated.hold((0.0, 0.0, 0.0), 5.0)
    until(lambda: emulated.tip_state().motor_n[0] > 1.0, lambda: robot.write((40.0, 0.0, 0.0)))
    until(lambda: emulated.tip_state().motor_n == (0.0, 0.0, 0.0))
    assert robot.faults == {"stale commands": 1}
    robot.write((40.0, 0.0, 0.0))
    until(lambda: emulated.tip_state().motor_n[0] > 0.0, lambda: robot.write((40.0, 0.0, 0.0)))
    assert emulated.tip_state().motor_n[0] < 0.5  # the point starts again where the tip is


def test_warm_motors_give_no_force_and_the_person_is_told_once(robot, emulated, caplog):
    with caplog.at_level(logging.WARNING):
        emulated.fail("warm")
        until(lambda: robot.faults.get("WARM_MOTORS", 0) > 5, lambda: robot.write((9.0, 0.0, 0.0)))
        robot.read()
    (said,) = caplog.messages
    assert said.startswith("Emulated HD device EMULATED1: the motors are too warm and give no forc")
    emulated.fail("warm", on=False)
    until(lambda: robot.read()[0] > 8.0, lambda: robot.write((9.0, 0.0, 0.0)))


def test_a_device_that_does_not_answer_is_lost_and_comes_back(robot, emulated):
    robot.calibrate()
    emulated.unplug()
    until(lambda: robot.faults.get("COMM_ERROR", 0) > 0)
    emulated.plug()  # a moment is survived
    before = emulated.ticks
    until(lambda: emulated.ticks > before + 1)
    until(lambda: robot.read()[0] > 1.0, lambda: robot.write((2.0, 0.0, 0.0)))
    emulated.unplug()
    until_lost(robot.read, r"does not answer.*check cable")
    check_refused(robot.connect, "COMM_ERROR")
    emulated.plug()
    robot.connect()
    until(lambda: robot.read()[0] > 1.0, lambda: robot.write((2.0, 0.0, 0.0)))
    for fault, sentence in (("fault", "HD_DEVICE_FAULT"), ("stalled", "servo loop has stopped")):
        emulated.fail(fault)
        until_lost(robot.read, sentence)
        emulated.fail(fault, on=False)
        robot.connect()
        robot.read()


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


def test_a_device_that_cannot_be_used_says_why(make, emulated, monkeypatch):
    emulated.fail("unlicensed")
    check_refused(make, "licence is missing")
    emulated.fail("unlicensed", on=False)
    for force_n, stiffness_n_mm, kind, words in (
        (8.5, 0.4, InputError, r"at most 0\.4"),
        (0.0, 3.5, MmtError, "no limit is known"),
        (float("nan"), 3.5, MmtError, "no limit is known"),
    ):
        emulated.limits(force_n, stiffness_n_mm)
        with pytest.raises(kind, match=words):
            make()
    emulated.fail("absent")
    monkeypatch.setitem(sys.modules, "serial", None)  # which this driver does not need
    check_refused(make, r"is not there.*its power, its cable")
    found = [
        FoundPort("/dev/ttyACM7", "Touch", "", "no permission for /dev/ttyACM7: ask"),
        FoundPort("/dev/ttyS0", "", "", ""),
    ]
    monkeypatch.setattr(discovery, "find_serial_ports", lambda: found)
    check_refused(make, r"then connect again; no permission for /dev/ttyACM7: ask$")


def test_two_devices_share_the_stack_and_one_name_is_used_once(make, emulated):
    first, second = make(device="Left"), make(device="Right")
    emulated.place((3.0, 0.0, 0.0), device=1)
    until(lambda: second.read()[0] == pytest.approx(3.0))
    check_refused(lambda: make(device="Left"), "in use already")
    first.close()
    until(lambda: second.read()[0] > 4.0, lambda: second.write((5.0, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("styles", "sentence"),
    [
        (AUTO, "move the tip slowly"),
        (INKWELL, "put the stylus into the inkwell"),
        (ENCODER_RESET, "reset_encoders = true"),
    ],
)
def test_a_calibration_that_needs_hands_says_what_to_do(make, emulated, styles, sentence):
    robot = make(calibration_s=0.0)
    emulated.uncalibrate(styles, NEEDS_HANDS)
    check_refused(robot.calibrate, sentence)


def test_a_calibration_that_is_due_is_updated(make, robot, emulated):
    emulated.uncalibrate(AUTO | INKWELL, NEEDS_UPDATE)
    robot.calibrate()
    until(lambda: robot.read()[0] > 100.0)  # the zero is another one, and nothing has jumped
    assert robot.faults == {}  # it has kept to one frame a tick

    def come_back_uncalibrated(device):
        emulated.uncalibrate(ENCODER_RESET, NEEDS_HANDS)  # where it stands now is no zero
        device.close()
        check_refused(device.connect, "reset position")

    come_back_uncalibrated(robot)
    reset = make(reset_encoders=True)
    reset.calibrate()
    come_back_uncalibrated(reset)
    emulated.uncalibrate(0, NEEDS_HANDS)
    reset.connect()
    reset.calibrate()  # a device without calibration needs none


PROGRAM = """
import sys
from mmt.core.errors import MmtError
from mmt.devices.drivers import load_device
for library in sys.argv[1:]:
    try:
        load_device("openhaptics", {"library": library}, role="robot").connect()
    except MmtError as error:
        print(error)
"""


def run_alone(*libraries):
    """Connect with these libraries in a process of its own; return the lines that it says."""
    return printed_by("-c", PROGRAM, *libraries).splitlines()


def test_a_library_that_cannot_be_loaded_says_what_to_do(tmp_path, monkeypatch):
    other = tmp_path / "libHD.so"
    other.write_text("no library")
    lines = run_alone(str(tmp_path / "none.so"), "libnowhere.so", "libm.so.6", str(other))
    assert "there is no such file: install" in lines[0]
    assert "give the library's path" in lines[1]
    assert "is no OpenHaptics HD library" in lines[2]
    assert "cannot be loaded" in lines[3]
    monkeypatch.setattr("os.access", lambda _path, _mode: False)
    with pytest.raises(InputError, match="you may not read it: ask its owner"):
        Stack(str(other))


def test_a_process_has_one_driver_stack_and_leaves_no_thread_behind(emulated):
    assert run_alone("emulated") == []  # it ends without closing
    (refused,) = run_alone("emulated", "/usr/lib/libHD.so")
    assert "must be driven by another process" in refused


@pytest.fixture
def make_handle(emulated, connected):
    def handle(**options):
        options = {"library": emulated.address, **options}
        made = connected(load_device("openhaptics", options, role="handle"))
        made.calibrate()
        return made

    return handle


def test_the_handle_says_where_it_is_and_how_it_moves(make_handle, emulated):
    handle = make_handle(origin_mm=(0.0, 0.0, -30.0))
    assert handle.read(1).position_mm == pytest.approx((0.0, 0.0, 30.0))
    emulated.hold((0.0, 100.0, 0.0), 0.2)
    until(lambda: handle.read(1).velocity_mm_s[2] > 50.0)
    until(lambda: handle.read(1).position_mm[2] == pytest.approx(130.0, abs=0.1))
    assert handle.read(1).force_n == 0.0


def test_a_displayed_force_reaches_the_hand_and_fades_as_commands_stop(make_handle, emulated):
    handle = make_handle()
    emulated.hold((0.0, 0.0, 0.0), 0.5)
    until(
        lambda: handle.read(1).position_mm == pytest.approx((0.6, 0.4, 2.0), abs=0.05),
        lambda: handle.write((0.3, 0.2, 1.0)),
    )
    # the display reaches the full force by a ramp, which a held-up thread is late with
    until(
        lambda: emulated.tip_state().motor_n == pytest.approx((0.3, 1.0, -0.2)),
        lambda: handle.write((0.3, 0.2, 1.0)),
    )
    until(lambda: emulated.tip_state().motor_n == (0.0, 0.0, 0.0))
    assert handle.faults == {"stale commands": 1}


@pytest.mark.parametrize(
    ("device_n", "limit_n", "asked", "expected"),
    [
        (2.0, 10.0, (0.0, 80.0, 60.0), (0.0, 1.2, -1.6)),
        # friction takes nothing from the pressure: along the normal 3 N stay 3 N
        (8.0, [1.0, 2.0, 3.0], (5.0, -9.0, 3.0), (1.0, 3.0, 2.0)),
    ],
)
def test_the_displayed_force_is_cut_to_the_limits(
    make_handle, emulated, device_n, limit_n, asked, expected
):
    emulated.limits(device_n, 3.5)
    handle = make_handle(force_limit_n=limit_n)
    emulated.hold((0.0, 0.0, 0.0), 50.0)
    until(
        lambda: emulated.tip_state().motor_n == pytest.approx(expected, abs=1e-6),
        lambda: handle.write(asked),
    )
    for force in ((math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)):
        handle.write(force)
    assert handle.faults["commands that are not finite"] == 2
    handle.connect()
    assert handle.faults["commands that are not finite"] == 2
    emulated.unplug()
    until_lost(lambda: handle.read(1), "does not answer")
    with pytest.raises(DeviceLost):
        handle.write((0.0, 0.0, 1.0))
    handle.close()
    check_refused(lambda: handle.read(1), "not connected", DeviceLost)
