"""Vibration goes on while frames are lost, through both services."""

from pathlib import Path

import numpy as np
import pytest
from service_runs import Together, small_scene

from mmt.session import read_session
from mmt.session.recorded import missing_frames


@pytest.mark.parametrize("way", ["model", "repetition"])
async def test_vibration_goes_on_where_frames_are_lost(tmp_path: Path, way: str) -> None:
    scene = small_scene(
        tmp_path,
        session={"duration_s": 2.5},
        link={"port": 0, "keep_s": 0},  # what is lost stays lost
        playout={"conceal": way},
        network={"direction": "up", "loss": 0.2, "burst_messages": 12},
    )
    together = Together.of(scene)
    await together.listen()
    await together.follow()
    leader = await together.end()
    recorded = read_session(tmp_path / "session.mcap")
    played = np.concatenate([block.vibration_m_s2 for block in recorded.outputs])
    played = played[np.flatnonzero(played)[0] :]
    lost = missing_frames(recorded.frames)
    assert lost > 100
    assert leader.vibration["playout"]["bridged"] > 100
    # fading out, 7 of the 12 samples of a burst would be zero: a tenth of all
    assert np.mean(played == 0.0) < 0.04
    assert np.abs(played).max() <= scene.actuator.limit_m_s2
