"""The parts of the driver for Universal Robots that need no arm: frame, servo point, packages."""

import itertools
import math
import re
import socket
import socketserver
import sys
import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mmt.core.errors import MmtError
from mmt_devices.universal_robots import dashboard
from mmt_devices.universal_robots.control import PLAYING, ArmControl
from mmt_devices.universal_robots.emulated import ports
from mmt_devices.universal_robots.frame import SceneFrame
from mmt_devices.universal_robots.servo import ServoPoint, ServoSettings

PERIOD_S = 0.002
SETTINGS = ServoSettings(
    speed_m_s=0.25,
    acceleration_m_s2=5.0,
    force_limit_n=10.0,
    normal=(0.0, 0.0, 1.0),
    lookahead_s=0.03,
    gain=300.0,
)
FREE = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("vector", [(0.0, 0.0, 0.0), (0.3, -1.1, 0.7), (2.2, 2.2, 0.0)])
def test_a_rotation_vector_turns_as_its_matrix_exponential_does(vector):
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    term, total = np.eye(3), np.eye(3)
    for power in range(1, 40):
        term = term @ cross / power
        total = total + term
    columns = [SceneFrame(FREE, vector).to_base(each) for each in np.eye(3).tolist()]
    assert np.transpose(columns) == pytest.approx(total, abs=1e-12)


def test_frames_of_both_kinds_go_both_ways():
    frame = SceneFrame((100.0, 200.0, 300.0), (0.0, 0.0, math.pi / 2))  # a quarter about z
    assert frame.place_in_base((10.0, 0.0, 5.0)) == pytest.approx((0.1, 0.21, 0.305))
    assert frame.to_scene((0.0, 2.0, 3.0)) == pytest.approx((2.0, 0.0, 3.0))
    frame = SceneFrame((1.0, -2.0, 3.0), (0.4, -0.8, 1.9))
    for place in itertools.product((-50.0, 70.0), repeat=3):
        assert frame.place_in_scene(frame.place_in_base(place)) == pytest.approx(place)
        assert frame.to_scene(frame.to_base(place)) == pytest.approx(place)


def travelled(point, target, periods=2000, force_n=FREE):
    return np.array([point.move(target, force_n, PERIOD_S) for _ in range(periods)])


def test_the_point_keeps_its_bounds_and_comes_to_rest_without_overshoot():
    target = np.array([0.1, -0.05, 0.02])
    path = travelled(ServoPoint(SETTINGS, FREE), tuple(target))
    path = np.vstack([np.zeros((2, 3)), path])
    velocity = np.diff(path, axis=0) / PERIOD_S
    speed = np.linalg.norm(velocity, axis=1)
    change = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / PERIOD_S
    assert speed.max() == pytest.approx(0.25, rel=1e-6)
    assert change.max() <= 5.0 * (1.0 + 1e-6)
    assert path[-1] == pytest.approx(target, abs=1e-9)
    along = path @ target / np.linalg.norm(target)
    assert along.max() <= np.linalg.norm(target) + 1e-5


def test_the_point_trails_a_steady_stroke_by_what_it_says():
    point = ServoPoint(SETTINGS, FREE)
    for tick in range(1, 1000):
        target = (0.1 * tick * PERIOD_S, 0.0, 0.0)
        place = point.move(target, FREE, PERIOD_S)
    expected_m = 0.1**2 / (2 * 5.0)
    assert target[0] - place[0] == pytest.approx(expected_m, rel=0.5)


def test_a_pressed_tip_is_sent_no_deeper_but_along_the_surface_and_back():
    point = ServoPoint(SETTINGS, FREE)
    assert travelled(point, (0.02, 0.0, -0.01), 500, (0.0, 0.0, 11.0))[-1] == pytest.approx(
        (0.02, 0.0, 0.0), abs=1e-6
    )
    assert point.held_back
    assert travelled(point, (0.02, 0.0, 0.01), 500, (0.0, 0.0, 11.0))[-1][2] == pytest.approx(0.01)
    assert not point.held_back
    tilted = ServoPoint(replace(SETTINGS, normal=(0.0, 1.0, 0.0)), FREE)
    assert travelled(tilted, (0.0, -0.01, -0.01), 500, (0.0, 11.0, 0.0))[-1] == pytest.approx(
        (0.0, 0.0, -0.01), abs=1e-6
    )


def test_packages_of_rtde_come_out_whole_however_they_were_cut():
    recipe = ports.Recipe(b"timestamp,actual_TCP_pose,output_int_register_7,")
    values = {
        "timestamp": 1.5,
        "actual_TCP_pose": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
        "output_int_register_7": -3,
    }
    sent = ports.pack(ports.DATA, recipe.pack(values)) + ports.pack(ports.START)
    received, found = bytearray(), []
    for byte in sent:
        received.append(byte)
        found += ports.packages(received)
    assert [kind for kind, _ in found] == [ports.DATA, ports.START]
    assert recipe.unpack(found[0][1]) == values
    assert sent[:3] == b"\x00\x3fU"  # size 3 + 8 + 48 + 4, big-endian, and the kind
    assert recipe.answer(1) == b"\x01DOUBLE,VECTOR6D,INT32"
    assert ports.Recipe(b"timestamp,payload_mass").answer(1) == b"\x00DOUBLE,NOT_FOUND"
    with pytest.raises(ValueError, match="2 bytes"):
        list(ports.packages(bytearray(b"\x00\x02U")))


@pytest.fixture
def answering(monkeypatch):
    """What a dashboard server at the loopback address 127.0.0.1 answers."""
    answers = {
        "safetystatus": "Safetystatus: NORMAL",
        "robotmode": "Robotmode: RUNNING",
        "is in remote control": "true",
    }

    class Dashboard(socketserver.StreamRequestHandler):
        def handle(self):
            self.wfile.write(b"Connected: Universal Robots Dashboard Server\n")
            for line in self.rfile:
                answer = answers.get(line.decode().strip(), "could not understand")
                self.wfile.write(f"{answer}\n".encode())

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Dashboard) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,)).start()
        monkeypatch.setattr(dashboard, "PORT", server.server_address[1])
        yield answers
        server.shutdown()


@pytest.mark.parametrize(
    ("question", "answer", "told"),
    [
        ("safetystatus", "Safetystatus: NORMAL", "^$"),
        ("safetystatus", "Safetystatus: REDUCED", "^$"),
        ("safetystatus", "Safetystatus: PROTECTIVE_STOP", "is in a protective stop"),
        ("safetystatus", "Safetystatus: SAFEGUARD_STOP", "stopped by a safeguard"),
        ("safetystatus", "Safetystatus: AUTOMATIC_MODE_SAFEGUARD_STOP", "stopped by a safeguard"),
        ("safetystatus", "Safetystatus: ROBOT_EMERGENCY_STOP", "release the red button"),
        ("safetystatus", "Safetystatus: SYSTEM_EMERGENCY_STOP", "emergency stop of the system"),
        ("safetystatus", "Safetystatus: VIOLATION", "violated a safety limit"),
        ("safetystatus", "Safetystatus: FAULT", "safety fault"),
        ("safetystatus", "Safetystatus: RECOVERY", "recovery mode"),
        ("robotmode", "Robotmode: IDLE", "shows IDLE.*release its brakes"),
        ("is in remote control", "false", "not in remote control"),
        ("is in remote control", "could not understand", "^$"),
    ],
)
def test_what_the_dashboard_says_is_told_with_what_to_do(answering, question, answer, told):
    answering[question] = answer
    assert re.search(told, dashboard.problem("127.0.0.1"))


def test_a_host_without_a_controller_is_named(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        monkeypatch.setattr(dashboard, "PORT", taken.getsockname()[1])
    with pytest.raises(MmtError, match=r"no UR controller answers at 127\.0\.0\.1"):
        dashboard.problem("127.0.0.1")


def test_a_stop_between_two_questions_is_told_as_a_stop(monkeypatch):
    """The first question is answered before the stop, the others after it."""
    modes, off = itertools.chain([7], itertools.repeat(3)), {"safetystatus": "FAULT"}
    monkeypatch.setattr(
        dashboard,
        "_ask",
        lambda _, asked: ["RUNNING", *(off.get(question, "POWER_OFF") for question in asked[1:])],
    )
    assert "has a safety fault" in dashboard.problem("arm")
    interface = SimpleNamespace(setWatchdog=lambda _: True)
    library = SimpleNamespace(RTDEControlInterface=lambda *_: interface)
    monkeypatch.setitem(sys.modules, "rtde_control", library)
    receive = SimpleNamespace(
        getRobotMode=lambda: next(modes),
        getSafetyStatusBits=lambda: 1 << 9 if next(modes) == 3 else 0,
        getRuntimeState=lambda: PLAYING,
        getActualTCPPose=lambda: [0.0] * 6,
    )
    control = ArmControl("arm", 500.0, SETTINGS, receive)
    control.watch()
    assert "has a safety fault" in control.lost
