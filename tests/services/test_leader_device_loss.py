"""The leader goes on without its handle and its actuator, and with them again."""

import asyncio
import math
from itertools import pairwise

import pytest
from emulated_arm import emulated_arm  # noqa: F401 - a fixture
from service_runs import Together, small_scene

from mmt.session.files import read_session
from mmt.testing.emulated.haptuator import EmulatedHaptuator
from mmt.testing.emulated.haptuator_board import EmulatedHaptuatorBoard

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


@pytest.mark.parametrize("fault", ["comm_lost", "fault", "stalled"])
async def test_a_handle_is_lost_and_comes_back_elsewhere(tmp_path, emulated, fault):
    together = Together.of(with_handle(tmp_path, emulated))
    sent = commands_of(together)
    await together.listen()
    following = asyncio.create_task(together.follow())
    await together.until(lambda: together.leader.time_s > 0.2)
    handle = together.leader.parts.hand.handle
    assert handle is not None
    emulated.fail(fault)
    await together.until(lambda: handle.lost)
    held, since = sent[-1][1], len(sent)
    assert any(sentence.startswith("the handle (OpenHapticsHandle) is lost")
               for sentence in together.leader.health.faults())  # fmt: skip
    await together.until(lambda: len(sent) > since + 100)
    assert {position for _, position in sent[since:]} == {held}
    await together.until(lambda: emulated.tip_state().motor_n == (0.0, 0.0, 0.0))
    emulated.fail(fault, on=False)
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
    told = [event for event in read_session(tmp_path / "session.mcap").events
            if event.get("device") == "handle"]  # fmt: skip
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


async def lose_actuator(together, unplug, plug):
    """Run a session whose actuator is unplugged and plugged in again."""
    actuator = together.leader.parts.vibration.reconnecting
    await together.listen()
    following = asyncio.create_task(together.follow())
    await together.until(lambda: actuator.statistics.samples > 100)
    unplug()
    await together.until(lambda: actuator.lost)
    time_s = together.leader.time_s
    await together.until(lambda: together.leader.time_s > time_s + 0.1)
    plug()
    await together.until(lambda: not actuator.lost)
    samples = actuator.statistics.samples
    await together.until(lambda: actuator.statistics.samples > samples + 100)
    leader, follower = await together.stop(), await following
    assert (leader.problem, follower.problem) == (None, None)
    table = leader.vibration["actuator"]
    assert table["losses"] == 1
    assert table["lost_samples"] >= 50
    assert table["lost_s"] > 0.0
    told = [event["state"] for event in read_session(together.leader.scene.recording.file).events
            if event.get("device") == "actuator"]  # fmt: skip
    assert (told[0], told[-1]) == ("lost", "back")


async def test_a_sound_card_is_lost_and_comes_back(tmp_path):
    together = Together.of(
        small_scene(
            tmp_path,
            session={"duration_s": 600.0},
            actuator={
                "driver": "mmt.testing.emulated.haptuator:emulated_haptuator",
                "volts_per_m_s2": 0.05,
                "full_scale_v": 3.0,
            },
        )
    )
    mended = together.leader.parts.vibration.reconnecting
    device = mended.device
    assert isinstance(device, EmulatedHaptuator)
    await lose_actuator(together, device.card.unplug, device.card.plug)


async def test_a_board_on_a_serial_port_is_lost_and_comes_back(tmp_path):
    pytest.importorskip("pty", reason="there are no pseudo-terminals")
    board = EmulatedHaptuatorBoard()
    board.start()
    try:
        together = Together.of(
            small_scene(
                tmp_path,
                session={"duration_s": 600.0},
                actuator={
                    "driver": "haptuator-serial",
                    "port": board.path,
                    "volts_per_m_s2": 0.05,
                    "full_scale_v": 3.0,
                },
            )
        )
        await lose_actuator(together, board.unplug, board.plug)
    finally:
        board.stop()
