"""An Inverse3 leads a simulated follower through both services, at the emulated service."""

import asyncio

import numpy as np
import pytest
from service_runs import Together, run_session, small_scene

from mmt.session.files import read_session
from mmt_devices.inverse3.emulated import EmulatedInverse3, stroking_hand
from mmt_devices.inverse3.emulated_tip import EmulatedTip


@pytest.fixture
def service(started):
    tip = EmulatedTip((0.0, -150.0, 155.0), stroking_hand(seed=3))
    return started(EmulatedInverse3({"049D": tip}))


def scene_of(service, tmp_path, duration_s, timeout_ms):
    return small_scene(
        tmp_path,
        session={"duration_s": duration_s},
        hand=None,
        handle={"driver": "inverse3", "timeout_ms": timeout_ms, **service.options},
        force_feedback={},
    )


async def test_a_stroking_hand_on_the_handle_moves_the_follower_and_feels_its_surface(
    tmp_path, service
):
    scene = scene_of(service, tmp_path, 2.5, 2000)
    leader, follower = await run_session(scene, None)
    assert service.tip_state().motor_n == (0.0, 0.0, 0.0)
    assert (leader.outcome, follower.problem) == ("completed", None)
    frames = read_session(tmp_path / "session.mcap").frames
    pressed = frames["force_n"][:, 2] > 0.1
    assert pressed.mean() > 0.2
    assert np.ptp(frames["position_mm"][:, 0]) + np.ptp(frames["position_mm"][:, 1]) > 10.0


async def test_a_handle_whose_service_fails_is_lost_and_comes_back(tmp_path, service):
    together = await Together.listening(scene_of(service, tmp_path, 600.0, 500))
    following = asyncio.create_task(together.follow())
    await together.until(lambda: together.leader.time_s > 0.2)
    handle = together.leader.parts.hand.handle
    assert handle is not None
    service.drop()
    await together.until(lambda: handle.losses == 1)
    await together.until(lambda: not handle.lost)
    service.stall()
    await together.until(lambda: handle.losses == 2)
    assert any("has not answered" in sentence for sentence in together.leader.health.faults())
    service.stall(silent=False)
    await together.until(lambda: not handle.lost)
    together.leader.stop()
    leader, follower = await together.end(), await following
    assert (leader.problem, follower.problem) == (None, None)
    assert leader.handle["losses"] == 2
