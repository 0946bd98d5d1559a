"""The Haply Inverse3 as handle and as robot, at an emulated service."""

import logging
import math
import os
import signal
import socket
import subprocess
import sys
import threading

import psutil
import pytest
from waiting import check_refused, children, until, until_lost

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.drivers import load_device
from mmt_devices.inverse3.emulated import REST_MM, EmulatedInverse3
from mmt_devices.inverse3.emulated_tip import EmulatedTip

PROCESS = "mmt_devices.inverse3.process"


@pytest.fixture
def service(started):
    yield started(EmulatedInverse3())
    assert not children(PROCESS)


@pytest.fixture
def make(service, closing):
    """Makes a driver of a role, with these options besides, and connects it."""
    options = {**service.options, "timeout_ms": 1000}

    def made(role, *, calibrate=True, **more):
        device = closing(load_device("inverse3", {**options, **more}, role=role))
        device.connect()
        if calibrate:
            device.calibrate()
        device.position = lambda: device.read(1).position_mm if role == "handle" else device.read()
        return device

    return made


def on_device(x, y, z):
    return (x + REST_MM[0], y + REST_MM[1], z + REST_MM[2])


def test_the_handle_says_where_it_is_and_how_it_moves_in_the_scenes_axes(make, service):
    handle = make("handle", origin_mm=(-150.0, 0.0, 120.0), axes="y,-x,z")
    assert handle.read(1).position_mm == pytest.approx((0.0, 0.0, 30.0))
    service.tip.hold(on_device(0.0, 40.0, 100.0), 0.2)
    until(lambda: handle.read(1).velocity_mm_s[2] > 50.0)
    until(lambda: handle.read(1).position_mm == pytest.approx((40.0, 0.0, 130.0), abs=0.1))
    assert handle.read(1).force_n == 0.0
    assert service.profile == "mmt"
    service.tip.hold(on_device(0.0, 40.0, 100.0), 5.0)
    until(
        lambda: service.tip_state().motor_n == pytest.approx((-0.2, 0.1, 0.3)),
        lambda: handle.write((0.1, 0.2, 0.3)),
    )
    handle.close()
    until(lambda: service.tip_state().motor_n == (0.0, 0.0, 0.0))
    handle.close()
    check_refused(lambda: handle.read(1), "not connected", DeviceLost)


@pytest.mark.parametrize("version", ["3.4", "3.5"])
def test_a_displayed_force_reaches_the_hand_and_fades_without_commands(version, make, service):
    service.version = version
    service.tip.hold(REST_MM, 0.5)
    handle = make("handle")
    until(
        lambda: service.tip_state().motor_n == pytest.approx((0.3, 0.2, 1.0)),
        lambda: handle.write((0.3, 0.2, 1.0)),
    )
    until(
        lambda: handle.read(1).position_mm == pytest.approx((0.6, 0.4, 2.0), abs=0.05),
        lambda: handle.write((0.3, 0.2, 1.0)),
    )
    until(lambda: service.tip_state().motor_n == (0.0, 0.0, 0.0))  # commands have stopped
    until(lambda: handle.faults.get("stale commands", 0) >= 1)  # told after the service is


def test_the_displayed_force_is_cut_to_the_limit(make, service):
    service.tip.hold(REST_MM, 20.0)
    handle = make("handle", force_limit_n=2.0)
    until(
        lambda: math.hypot(*service.tip_state().motor_n) > 2.0 - 1e-9,
        lambda: handle.write((0.0, 80.0, 60.0)),
    )
    assert service.tip_state().motor_n == pytest.approx((0.0, 1.6, 1.2))
    for force in ((math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)):
        handle.write(force)
    assert handle.faults["commands that are not finite"] == 2
    assert math.hypot(*service.tip_state().motor_n) <= 2.0 + 1e-9


def test_the_arm_goes_where_it_is_told_in_the_scenes_axes(make, service):
    robot = make("robot")
    target = (12.0, -7.0, 4.0)
    until(lambda: math.dist(robot.read(), target) < 0.05, lambda: robot.write(target))
    assert service.tip_state().position_mm == pytest.approx(on_device(*target), abs=0.1)
    robot.await_turn()
    for position in ((math.nan, 0.0, 0.0), (0.0, -math.inf, 0.0)):
        robot.write(position)
    assert robot.faults["commands that are not finite"] == 2


def test_an_arm_that_is_held_fast_is_lost_and_another_connection_begins_where_it_is(make, service):
    robot = make("robot", lead_limit_mm=2.0)
    service.tip.braked = True
    until_lost(
        lambda: robot.write((30.0, 0.0, 0.0)), r"stays the same though .* no emergency brake"
    )
    service.tip.braked = False
    robot.connect()
    until(lambda: robot.read()[0] > 5.0, lambda: robot.write((30.0, 0.0, 0.0)))


@pytest.fixture(params=["handle", "robot"])
def device(request, make):
    return make(request.param)


def lost(device, sentence):
    until_lost(device.position, sentence)
    with pytest.raises(DeviceLost):
        device.write((0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("absent", "does not list inverse3 049D at ws://.* any more: check its cable"),
        ("nonsense", "has given answers that cannot be read for 100 ms"),
        ("numberless", "has given answers that cannot be read for 100 ms"),
        ("nan", "has given positions that are no numbers"),
        ("far", "has given positions out of reach"),
        ("uncalibrated", "has given positions without calibration"),
    ],
)
def test_a_device_that_gives_nothing_usable_is_lost_and_comes_back(
    fault, sentence, device, service
):
    service.fail(fault)
    lost(device, sentence)
    counted = device.faults
    assert sum(counted.values()) >= 20
    assert service.tip_state().motor_n == (0.0, 0.0, 0.0)
    service.fail(fault, on=False)
    device.connect()
    assert device.position() == pytest.approx((0.0, 0.0, 0.0))
    assert all(device.faults[fault] >= count for fault, count in counted.items())


def test_a_service_that_is_stuck_is_lost_and_comes_back(make, service):
    robot = make("robot", timeout_ms=50)
    service.stall()
    lost(robot, "has not answered for 50 ms: it is stuck or overloaded")
    check_refused(robot.connect, "has not answered")
    service.stall(silent=False)
    robot.connect()
    assert robot.read() == pytest.approx((0.0, 0.0, 0.0))


def test_a_service_that_leaves_is_lost_and_another_at_its_place_is_taken(device, service):
    service.drop()
    lost(device, r"has closed the connection \(.+\): see whether it still runs")
    service.stop()
    check_refused(device.connect, r"does not answer at .*: start it")
    service.start()
    device.connect()
    assert device.position() == pytest.approx((0.0, 0.0, 0.0))


def test_a_process_that_dies_is_a_device_that_is_lost_and_comes_back(device, service):
    (process,) = children(PROCESS)
    process.kill()
    lost(device, "the process that talks with ws://.* has ended")
    device.connect()
    assert device.position() == pytest.approx((0.0, 0.0, 0.0))


HOLDING = """
import sys, time
from mmt.devices.drivers import load_device
handle = load_device("inverse3", {"address": sys.argv[1], "timeout_ms": 2000}, role="handle")
handle.connect()
while True:
    handle.write((0.0, 0.0, 1.0))
    time.sleep(0.001)
"""


@pytest.fixture
def holder(service):
    """Another program that displays a force."""
    service.tip.hold(REST_MM, 20.0)
    with subprocess.Popen(
        [sys.executable, "-c", HOLDING, service.options["address"]], stderr=subprocess.DEVNULL
    ) as program:
        try:
            until(lambda: service.tip_state().motor_n == pytest.approx((0.0, 0.0, 1.0)))
            yield program
        finally:
            program.kill()


@pytest.mark.skipif(sys.platform == "win32", reason="signals are for Linux and macOS")
def test_the_force_fades_while_the_program_stands_still_and_comes_back(holder, service):
    shown = []
    holder.send_signal(signal.SIGSTOP)
    until(
        lambda: service.tip_state().motor_n[2] == 0.0,
        lambda: shown.append(service.tip_state().motor_n[2]),
    )
    assert any(0.1 < force_n < 0.9 for force_n in shown)  # by a ramp
    heard = service.heard
    until(lambda: service.heard > heard + 20)  # the conversation goes on
    holder.send_signal(signal.SIGCONT)
    until(lambda: service.tip_state().motor_n == pytest.approx((0.0, 0.0, 1.0)))


@pytest.mark.skipif(sys.platform == "win32", reason="signals are for Linux and macOS")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_however_a_program_ends_no_process_and_no_force_is_left(number, holder, service):
    (process,) = children(PROCESS, holder.pid)
    os.kill(holder.pid, number)
    holder.wait(60.0)
    psutil.wait_procs([process], timeout=20.0)
    assert not process.is_running()
    assert service.tip_state().motor_n == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("absent", "knows no Inverse3: plug it in and switch it on"),
        ("nonsense", "is no Haply Inverse Service: its first message is '<html>'"),
        ("nan", "inverse3 049D at ws://.* gives no position that makes sense"),
        ("mute", r"does not say which devices there are, within 0\.2 s"),
    ],
)
def test_a_first_message_that_cannot_be_used_is_explained(
    fault, sentence, make, service, monkeypatch
):
    monkeypatch.setattr("mmt_devices.inverse3.link._FIRST_S", 0.2)
    service.fail(fault)
    check_refused(lambda: make("handle"), sentence)


def test_what_is_no_service_of_the_format_is_explained(make, service):
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        with pytest.raises(MmtError, match=r"does not answer at .*haply-inverse-service"):
            make("handle", address=f"ws://127.0.0.1:{unused.getsockname()[1]}")
    with pytest.raises(MmtError, match=r"is no Haply Inverse Service \(it says 404"):
        make("handle", address=service.options["address"] + "/elsewhere")
    service.version = "3.0"
    check_refused(lambda: make("handle"), r"speaks the format 3\.0: give the port .* 10001")


def test_of_two_devices_one_must_be_named(make, service):
    service.tips = two = {"049D": EmulatedTip(REST_MM), "04BA": EmulatedTip(REST_MM)}
    words = r"has '049D' \(inverse3\), '04BA' \(inverse3\): name one by .*'device'"
    check_refused(lambda: make("robot"), words)
    check_refused(lambda: make("robot", device="0000"), r"has no device '0000', but '049D'")
    robot = make("robot", device="04BA")
    until(lambda: two["04BA"].mode == "position", lambda: robot.write((0.0, 0.0, 0.0)))
    assert two["049D"].mode == "idle"


def test_an_uncalibrated_device_is_waited_for(make, service, caplog):
    service.fail("uncalibrated")
    impatient = make("handle", calibration_s=0, calibrate=False)
    check_refused(impatient.calibrate, "is not calibrated: put its grip where")
    assert any("is not calibrated" in remark for remark in impatient.remarks())
    impatient.close()
    handle = make("handle", calibration_s=20, calibrate=False)
    later = threading.Timer(0.2, lambda: service.fail("uncalibrated", on=False))
    later.start()
    with caplog.at_level(logging.WARNING):
        handle.calibrate()
    later.join(60.0)
    assert "is not calibrated" in caplog.text
    handle.read(1)


def test_what_is_doubtful_about_a_device_is_remarked(make, service):
    service.fail("unpowered")
    first, second = make("handle"), make("robot")
    assert [remark.split("at ws")[1].partition(" ")[2] for remark in second.remarks()] == [
        "has no power supply and thus no force: plug it in",
        "is used by another program as well: end that one",
    ]
    assert first.remarks() == second.remarks()[:1]


def test_the_virtual_handle_strokes_by_itself_and_the_virtual_arm_follows(closing):
    handle, robot = (
        closing(load_device("virtual-inverse3", {"timeout_ms": 2000}, role=role))
        for role in ("handle", "robot")
    )
    for device in (handle, robot):
        with pytest.raises(DeviceLost, match="not connected"):
            device.write((0.0, 0.0, 0.0))
        device.connect()
        device.calibrate()
    until(
        lambda: math.hypot(*robot.read()[:2]) > 3.0 and robot.read()[2] < 0.0,
        lambda: robot.write(handle.read(1).position_mm),
    )
    assert robot.remarks() == []


def test_names_that_are_given_go_before_what_the_service_seems_to_be(make, service):
    service.tip.hold(REST_MM, 5.0)
    handle = make("handle", commands="3.1")
    heard = service.heard
    until(lambda: service.heard > heard + 200, lambda: handle.write((0.0, 0.0, 1.0)))
    assert service.tip_state().motor_n == (0.0, 0.0, 0.0)  # it does not understand them
