"""What LeRobot's plug-in does without LeRobot: the process beside it, and its parts."""

import asyncio
import math
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import tomli_w
from frame_samples import made_frames
from service_processes import LONGEST_S
from waiting import until, until_lost

from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.core.frames import acceleration_samples
from mmt.session.data import RecordedSession
from mmt_bridges.lerobot.dataset import state_names
from mmt_bridges.lerobot.observing import LONGEST_FRAMES, ActionHandle, ObservingPart
from mmt_bridges.lerobot.rows import low_rate_rows
from mmt_bridges.lerobot.session import SharedSession, shared_session
from mmt_bridges.lerobot.settings import Settings, session_scene

SCENE = """
[link]
patience_s = 0.5
[simulated]
workspace_mm = [[-50, -50, -10], [50, 50, 50]]
[hand]
[playout]
conceal = "silence"
[actuator]
[force_feedback]
[recording]
"""

PROGRAM = """
import sys
import psutil
from mmt_bridges.lerobot.session import SharedSession
from mmt_bridges.lerobot.settings import Settings

session = SharedSession(Settings(sys.argv[1]))
session.acquire("test")
session.release("test")
session.acquire("test")
session.ask("observe")
print(*(child.pid for child in psutil.Process().children()))
"""
"""Uses a session twice, and ends without a word."""


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    return str(tmp_path / "scene.toml")


@pytest.fixture
def started():
    sessions = []

    def start(settings):
        sessions.append(SharedSession(settings))
        sessions[-1].acquire("test")
        return sessions[-1]

    yield start
    for session in sessions:
        session.release("test")


def beside(session):
    """The process of the session."""
    assert session.running
    children = psutil.Process(os.getpid()).children()
    (process,) = (each for each in children if "mmt_bridges.lerobot.process" in each.cmdline())
    return process


def test_two_users_see_one_session_whose_hand_presses_until_the_last_leaves(scene):
    session = shared_session(scene, Settings(scene))
    assert shared_session(os.path.relpath(scene)) is session
    session.acquire("teleoperator")
    process = beside(session)
    session.acquire("robot")
    assert beside(session) == process
    with pytest.raises(InputError, match="with other settings"):
        shared_session(scene, Settings(scene, moved_by="actions"))
    names = state_names(session.scene.channels())
    force, level = names.index("force_z_n"), names.index("vibration_rms_m_s2")
    until(lambda: session.ask("observe")[force] > 0.5)
    until(lambda: session.ask("observe")[level] > 0.1)
    x, y, z = session.ask("command")
    assert z < 0.0  # below the surface, as the hand presses
    assert math.dist((x, y), session.ask("observe")[:2]) < 50.0
    session.release("teleoperator")
    until(lambda: session.ask("command") != [x, y, z])
    with pytest.raises(MmtError, match="hand moves the robot, it follows no actions"):
        session.ask("follow", (0.0, 0.0, 0.0))
    children = process.children(recursive=True)
    assert children
    session.release("robot")
    assert not session.running
    assert not psutil.wait_procs(children, LONGEST_S)[1]
    assert (Path(scene).parent / "mmt-demo" / "session.mcap").stat().st_size > 1000


def test_actions_move_the_robot_within_its_workspace_until_the_process_dies(scene, started):
    session = started(Settings(scene, moved_by="actions"))
    start = session.ask("observe")[:3]
    assert math.dist(start, (0.0, 0.0, 5.0)) < 1.0
    with pytest.raises(MmtError, match="no action has come yet"):
        session.ask("command")
    assert session.ask("follow", (2.0, -1.0, 6.0)) == [2.0, -1.0, 6.0]
    until(lambda: math.dist(session.ask("observe")[:3], (2.0, -1.0, 6.0)) < 0.5)
    assert session.ask("command") == [2.0, -1.0, 6.0]
    assert session.ask("follow", (2.0, -1.0, -30.0)) == [2.0, -1.0, -10.0]
    until(lambda: session.ask("observe")[5] > 1.0)  # it presses
    process = beside(session)
    children = process.children()
    process.kill()
    until(lambda: not session.running)
    for _ in range(2):
        with pytest.raises(DeviceLost, match="ended unexpectedly"):
            session.ask("observe")
    assert not psutil.wait_procs(children, LONGEST_S)[1]  # without a leader they end


def test_a_follower_that_is_lost_is_told(scene, started):
    session = started(Settings(scene))
    (follower,) = beside(session).children()
    follower.kill()
    until_lost(lambda: session.ask("observe"), ".")
    until(lambda: not session.running)
    with pytest.raises(DeviceLost, match="follower"):
        session.ask("observe")


def test_what_was_asked_before_ctrl_c_is_not_answered_afterwards(scene, started):
    session = started(Settings(scene))
    leader = beside(session)
    leader.suspend()
    press = (threading.main_thread().ident, signal.SIGINT)
    threading.Timer(0.3, signal.pthread_kill, press).start()
    with pytest.raises(KeyboardInterrupt):
        session.ask("command")
    leader.resume()
    assert len(session.ask("observe")) == len(state_names(session.scene.channels()))
    assert len(session.ask("command")) == 3


def test_a_program_that_ends_ends_its_second_session_too(scene):
    command = [sys.executable, "-c", PROGRAM, scene]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LONGEST_S)
    assert (ended.returncode, ended.stderr) == (0, "")
    (process,) = map(int, ended.stdout.split())
    assert not psutil.pid_exists(process)
    assert (Path(scene).parent / "mmt-demo" / "session-2.mcap").stat().st_size > 1000


def test_why_a_session_does_not_begin_is_one_sentence(scene):
    text = SCENE.replace("[simulated]", '[devices]\nrobot = "lost_lab:Robot"')
    Path(scene).write_text(text)
    session = SharedSession(Settings(scene))
    with pytest.raises(MmtError, match="lost_lab") as raised:
        session.acquire("test")
    assert "Traceback" not in str(raised.value)
    assert not session.running


def test_a_follower_elsewhere_is_not_waited_for_too_long(scene, unused_tcp_port, monkeypatch):
    monkeypatch.setenv("MMT_LINK__PORT", str(unused_tcp_port))
    session = SharedSession(Settings(scene, follower=False, wait_s=0.1))
    with pytest.raises(MmtError, match=r"no frame .* within 0\.1 s"):
        session.acquire("test")
    assert not session.running


def test_an_answer_that_comes_too_late_is_not_taken_for_the_next(monkeypatch):
    monkeypatch.setattr("mmt_bridges.lerobot.session._REPLY_S", 0.01)
    session, silent = SharedSession(Settings()), "import sys; sys.stdin.read()"
    session._process = process = subprocess.Popen(
        [sys.executable, "-c", silent], stdin=subprocess.PIPE
    )
    lines = session._lines
    with pytest.raises(DeviceLost, match="no answer within"):
        session.ask("observe")
    lines.put({"values": [1.0]})
    for _ in range(2):
        with pytest.raises(DeviceLost, match="no answer within"):
            session.ask("observe")
    assert process.wait(LONGEST_S) != 0
    assert process.stdin is not None
    with suppress(OSError):  # what was asked last cannot be sent any more
        process.stdin.close()


def test_settings_that_are_not_allowed_are_refused():
    with pytest.raises(InputError, match='moved_by is \'feet\', allowed is "hand", "actions"'):
        Settings(moved_by="feet")
    with pytest.raises(InputError, match="wait_s is nan, allowed is a finite number above 0"):
        Settings(wait_s=math.nan)
    for name in ("replay", "listener"):
        with pytest.raises(InputError, match="moves none: take one with"):
            session_scene(Settings(name))


def test_actions_take_the_place_of_the_hand_and_all_else_stays():
    by_hand, by_actions = (
        session_scene(Settings("demo", moved_by=who)).dump() for who in ("hand", "actions")
    )
    assert by_actions.pop("handle")["driver"] == "mmt_bridges.lerobot.observing:ActionHandle"
    assert by_hand.pop("hand")
    assert by_actions == by_hand


def test_the_way_to_the_first_action_and_after_a_pause_is_bounded_in_speed_and_box():
    box_mm = ((-1.0, -1.0, -1.0), (100.0, 1.0, 1.0))
    handle = ActionHandle(recovery_mm_s=50.0, box_mm=box_mm)
    assert handle.read(1) is None
    for start, asked, goal in ((0.0, 109.0, 100.0), (100.0, 0.0, 0.0)):
        assert handle.follow((asked, 0.0, 0.0), (0.0, 0.0, 0.0)) == (goal, 0.0, 0.0)
        state = handle.read(1000)
        assert state.position_mm[0] == pytest.approx(start + (goal - start) / 2)
        assert state.velocity_mm_s[0] == pytest.approx((goal - start) / 2)
        state = handle.read(1000)
        assert state.position_mm == (goal, 0.0, 0.0)
        assert handle.read(1) == (state.position_mm, (0.0, 0.0, 0.0), 0.0, False)


def test_actions_at_a_rate_give_a_steady_motion_a_period_late():
    handle, positions = ActionHandle(), []
    for k in range(11):
        handle.follow((0.0, 3.0 * k, 0.0), (0.0, 0.0, 0.0))
        for _ in range(30):
            state = handle.read(1)
            positions.append(state.position_mm[1])
    np.testing.assert_allclose(np.diff(positions[30:]), 0.1, atol=1e-9)
    assert positions[-1] == 30.0


@pytest.mark.parametrize(("normal", "force"), [("x", 0.3), ("y", 0.7), ("z", 1.5)])
def test_the_displayed_force_is_that_of_the_hand_along_the_scenes_normal(normal, force, tmp_path):
    tables = session_scene(Settings("demo")).dump()
    tables["texture"]["normal"] = normal
    # a simulated surface lies across z alone
    tables["handle"], tables["devices"] = {"driver": "a:Handle"}, {"robot": {"driver": "a:Arm"}}
    del tables["hand"], tables["simulated"]
    file = tmp_path / "scene.toml"
    file.write_bytes(tomli_w.dumps(tables).encode())
    options = session_scene(Settings(str(file), moved_by="actions")).handle.options
    handle = ActionHandle(**options)
    handle.follow((0.0, 0.0, 0.0), None)
    handle.write((0.3, 0.7, 1.5))
    assert handle.read(1) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), force, True)
    handle.write((-0.3, -0.7, -1.5))
    assert handle.read(1) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, False)


CONNECTED = SimpleNamespace(connected=True)


def observing(remote, samples_per_frame=1):
    scene = session_scene(Settings("demo"))
    hand = SimpleNamespace(device=None, command_mm=(1.0, 2.0, 3.0))
    session = SimpleNamespace(scene=scene, remote=remote, samples_per_frame=samples_per_frame)
    return ObservingPart(session, hand, asyncio.Event())


@pytest.mark.parametrize("samples", [1, 5])
def test_a_state_is_a_row_of_the_export(samples):
    frames = made_frames(0, 1000, samples_per_frame=samples)
    shape = frames["acceleration_m_s2"].shape
    frames["acceleration_m_s2"] = np.random.default_rng(5).normal(0.0, 3.0, shape)
    rows = low_rate_rows(RecordedSession(frames), 50)["observation.state"]
    every = acceleration_samples(frames[:20]).astype(float)
    assert rows[0][-1] == pytest.approx(math.sqrt(every.var(axis=0).sum()), rel=1e-6)
    part = observing(CONNECTED, samples)
    for k, row in enumerate(rows):
        for one in frames[20 * k : 20 * k + 20]:
            part.on_frames(np.array([one]), time.monotonic_ns())
        np.testing.assert_allclose(part.observe(), row, rtol=1e-5)
    np.testing.assert_allclose(part.observe()[-1], rows[-1][-1], rtol=1e-5)  # held


def test_what_is_long_past_is_not_in_the_level():
    frames = made_frames(0, 1000)
    part = observing(CONNECTED)
    part.on_frames(frames, time.monotonic_ns())
    newest = frames["acceleration_m_s2"][-LONGEST_FRAMES:].astype(float)
    expected = math.sqrt(newest.var(axis=0).sum())
    assert part.observe()[-1] == pytest.approx(expected, rel=1e-6)


def test_nothing_old_is_observed():
    remote = SimpleNamespace(connected=True)
    part = observing(remote)
    part.on_frames(made_frames(0, 1), time.monotonic_ns() - 600_000_000)
    with pytest.raises(DeviceLost, match=r"no frame .* 0\.6 s"):
        part.observe()
    part.on_frames(made_frames(1, 1), time.monotonic_ns())
    assert part.command() == (1.0, 2.0, 3.0)
    remote.connected = False
    for ask in (part.observe, part.command):
        with pytest.raises(DeviceLost, match="follower is lost"):
            ask()
