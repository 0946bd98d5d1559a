"""Vibration goes on while frames are lost, through both services."""

import asyncio

import numpy as np
import pytest
from service_runs import Together, small_scene

from mmt.session.data import missing_frames
from mmt.session.files import read_session


@pytest.mark.parametrize("way", ["model", "repetition"])
async def test_vibration_goes_on_where_frames_are_lost(tmp_path, way):
    scene = small_scene(
        tmp_path,
        link={"port": 0, "keep_s": 0},  # what is lost stays lost
        playout={"conceal": way},
        network={"direction": "up", "loss": 0.2, "burst_messages": 12},
    )
    together = await Together.listening(scene)
    following = asyncio.create_task(together.follow())
    playout = together.leader.parts.playout.buffer
    assert playout is not None

    def enough_is_lost():
        lost = together.leader.status().frames_lost
        return lost > 400 and playout.statistics().bridged > 200

    await together.until(enough_is_lost)
    assert (await together.stop()).problem is None
    await following
    recorded = read_session(tmp_path / "session.mcap")
    played = np.concatenate([block.vibration_m_s2 for block in recorded.outputs])
    played = played[np.flatnonzero(played)[0] :]
    assert missing_frames(recorded.frames) > 400
    # fading out, 7 of the 12 samples of a burst would be zero: a tenth of all; where the loop
    # that both share stalls, nothing comes and nothing is played, which is no loss of the network
    ticks = together.leader.ticker.statistics
    assert np.mean(played == 0.0) < 0.04 + ticks.missed / ticks.ticks
    assert np.abs(played).max() <= scene.actuator.limit_m_s2
