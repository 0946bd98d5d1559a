"""A handle and an actuator that are lost, and the session that goes on without them."""

import asyncio
import math
from itertools import pairwise

import numpy as np
import pytest
from emulated_arm import emulated_arm  # noqa: F401 - a fixture
from service_runs import Together, small_scene

from mmt.core.errors import MmtError
from mmt.scene.files import scene_from_tables
from mmt.session.files import read_session
from mmt.testing.emulated.haptuator_board import EmulatedHaptuatorBoard
from mmt.testing.emulated.openhaptics.hd import EmulatedHd

RECOVERY_MM_S = 50.0


def with_handle(directory, emulated, **handle):
    return small_scene(
        directory,
        session={"duration_s": 600.0},
        link={"port": 0, "recovery_mm_s": RECOVERY_MM_S},
        hand=None,
        handle={"driver": "openhaptics", "library": emulated.address, **handle},
        force_feedback={},
    )


def commands_of(together):
    """Collect what the leader asks of the follower, from now on, with its tick."""
    remote, sent = together.leader.remote, []
    send = remote.command

    def note(now_ns, position_mm):
        sent.append((together.leader.ticks, position_mm))
        send(now_ns, position_mm)

    remote.command = note
    return sent


def events_of(directory, device):
    """What the recording tells of a device."""
    events = read_session(directory / "session.mcap").events
    return [event for event in events if event.get("device") == device]


async def test_a_handle_is_lost_and_comes_back_elsewhere(tmp_path, emulated):
    together = Together.of(with_handle(tmp_path, emulated))
    sent = commands_of(together)
    await together.listen()
    following = asyncio.create_task(together.follow())
    await together.until(lambda: together.leader.time_s > 0.2)
    handle = together.leader.parts.hand.handle
    assert handle is not None
    emulated.fail("stalled")
    await together.until(lambda: handle.lost)
    held, since = sent[-1][1], len(sent)
    told = "the handle (OpenHapticsHandle) is lost"
    assert any(sentence.startswith(told) for sentence in together.leader.health.faults())
    await together.until(lambda: len(sent) > since + 100)
    assert {position for _, position in sent[since:]} == {held}
    await together.until(lambda: emulated.tip_state().motor_n == (0.0, 0.0, 0.0))
    emulated.fail("stalled", on=False)
    emulated.place((12.0, 6.0, 0.0))
    emulated.hold((12.0, 6.0, 0.0), 1.0)
    await together.until(lambda: not handle.lost)
    await together.until(lambda: math.dist(sent[-1][1], (12.0, 0.0, 6.0)) < 0.2)
    leader, follower = await together.stop(), await following
    assert (leader.problem, follower.problem) == (None, None)
    for (before, start), (after, end) in pairwise(sent[since:]):
        # the tip itself, pushed by the force that returns, moves a little
        assert math.dist(start, end) < (RECOVERY_MM_S / 1000 + 0.02) * (after - before)
    assert leader.handle["losses"] == 1
    # the robot was never without a command, but where this machine did not let the leader tick
    assert follower.commands["silences"] <= together.leader.ticker.statistics.missed // 50
    told = events_of(tmp_path, "handle")
    assert [event["state"] for event in told if event["state"] == "back"] == ["back"]
    assert told[0]["state"] == "lost"
    assert told[0]["time_s"] < told[-1]["time_s"]


async def test_a_scene_may_stop_without_its_handle(tmp_path, emulated):
    together = await Together.listening(with_handle(tmp_path, emulated, on_lost="stop"))
    following = asyncio.create_task(together.follow())
    await together.until(lambda: together.leader.time_s > 0.1)
    emulated.unplug()
    leader = await together.end()
    assert "does not answer" in str(leader.problem)
    await following
    assert len(read_session(tmp_path / "session.mcap").frames) > 50


@pytest.mark.parametrize("kind", ["sound card", "board on a serial port"])
async def test_an_actuator_is_lost_and_comes_back(tmp_path, started, kind):
    options = {"volts_per_m_s2": 0.05, "full_scale_v": 3.0}
    if kind == "sound card":
        options["driver"] = "mmt.testing.emulated.haptuator:EmulatedHaptuator"
    else:
        pytest.importorskip("pty", reason="there are no pseudo-terminals")
        board = started(EmulatedHaptuatorBoard())
        options |= {"driver": "haptuator-serial", "port": board.path}
    scene = small_scene(tmp_path, session={"duration_s": 600.0}, actuator=options)
    together = Together.of(scene)
    actuator = together.leader.parts.vibration.reconnecting
    cable = actuator.device.card if kind == "sound card" else board
    await together.listen()
    following = asyncio.create_task(together.follow())
    await together.until(lambda: actuator.statistics.samples > 100)
    cable.unplug()
    await together.until(lambda: actuator.lost)
    time_s = together.leader.time_s
    await together.until(lambda: together.leader.time_s > time_s + 0.1)
    cable.plug()
    await together.until(lambda: not actuator.lost)
    samples = actuator.statistics.samples
    await together.until(lambda: actuator.statistics.samples > samples + 100)
    leader, follower = await together.stop(), await following
    assert (leader.problem, follower.problem) == (None, None)
    table = leader.vibration["actuator"]
    assert table["losses"] == 1
    assert table["lost_samples"] >= 50
    assert table["lost_s"] > 0.0
    told = events_of(tmp_path, "actuator")
    assert (told[0]["state"], told[-1]["state"]) == ("lost", "back")


@pytest.fixture
def stroking(started):
    """An emulated arm whose hand moves to and fro."""

    def stroke(time_ns):
        return (20.0 * math.sin(6e-9 * time_ns), 10.0, 0.0)

    try:
        device = EmulatedHd(stroke, hand_n_mm=1.0)
    except MmtError as error:
        pytest.skip(str(error))
    return started(device)


STILL = """
class Still:
    def connect(self): pass
    def calibrate(self): pass
    def close(self): pass
    def read(self): return (0.0, 0.0, 0.0)
"""


async def test_the_handle_moves_the_followers_arm_and_both_come_back_once_unplugged(
    tmp_path, monkeypatch, stroking
):
    (tmp_path / "still_sensor.py").write_text(STILL)
    monkeypatch.syspath_prepend(str(tmp_path))
    arm = {"driver": "openhaptics", "library": stroking.address}
    tables = {
        "session": {"duration_s": 5.0},
        "link": {"port": 0},
        "handle": {**arm, "device": "Left"},
        "devices": {
            "robot": {**arm, "device": "Right"},
            "force_sensor": "still_sensor:Still",
            "accelerometer": "still_sensor:Still",
            "on_lost": "hold",
        },
        "force_feedback": {},
        "recording": {"file": str(tmp_path / "session.mcap")},
    }
    together = await Together.listening(scene_from_tables(tables))
    following = asyncio.create_task(together.follow())
    await together.until(lambda: together.leader.time_s > 1.5)
    stroking.unplug()
    await asyncio.sleep(0.5)
    motors = stroking.tip_state(device=0).motor_n, stroking.tip_state(device=1).motor_n
    stroking.plug()
    leader, follower = await together.end(), await following
    assert motors == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert (leader.outcome, follower.problem) == ("completed", None)
    assert follower.devices["robot"]["losses"] >= 1
    frames = read_session(tmp_path / "session.mcap").frames
    gaps = frames["sequence"][1:] - frames["sequence"][:-1]
    assert gaps.max() > 100  # while it was lost, nothing was invented
    assert np.ptp(frames["position_mm"][: gaps.argmax(), 0]) > 15.0
    after = frames["sequence"] > frames["sequence"][gaps.argmax() + 1]
    assert after.any()
