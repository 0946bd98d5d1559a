"""A leader that is connected but silent does not leave the robot to itself."""

import asyncio

import numpy as np
import pytest
from service_runs import Together, small_scene

from mmt.link.server import LeaderServer
from mmt.session.files import read_session


@pytest.mark.parametrize("on_silence", ["hold", "retract"])
async def test_the_robot_holds_or_retracts_and_takes_the_commands_up_again(
    tmp_path, monkeypatch, on_silence
):
    silent = False
    send = LeaderServer.send_commands

    def stifled(self, commands):
        if not silent:
            send(self, commands)

    monkeypatch.setattr(LeaderServer, "send_commands", stifled)
    link = {"port": 0, "patience_s": 5.0, "on_silence": on_silence, "retract_mm": 20.0}
    together = await Together.listening(
        small_scene(tmp_path, link=link, session={"duration_s": 3600.0})
    )
    follower = together.follower()
    following = asyncio.create_task(follower.run())
    await together.until(lambda: together.leader.time_s > 0.7)
    silent = True
    does = "holding" if on_silence == "hold" else "retracting"
    said = f"follower: leader silent for 0.1 s: {does}"
    await together.until(lambda: said in together.said)
    silent_from = together.leader.time_s
    await together.until(lambda: together.leader.time_s > silent_from + 0.8)
    silent = False
    await together.until(lambda: any("leader is back" in sentence for sentence in together.said))
    heard_from = together.leader.time_s
    await together.until(lambda: together.leader.time_s > heard_from + 0.3)
    await together.stop()
    summary = await following
    assert summary.commands["silences"] >= 1
    assert summary.commands["silent_s"] >= 0.7
    session = read_session(tmp_path / "session.mcap")
    recorded = [event["event"] for event in session.events]
    assert said in recorded
    assert any("s and " in event and event.endswith("mm/s") for event in recorded), recorded
    frames = session.frames
    held = frames[round(1000 * silent_from) + 600 : round(1000 * silent_from) + 750]
    spread_mm = np.ptp(held["position_mm"], axis=0)
    assert (spread_mm < 1.0).all()  # at rest but for the sensor's noise
    if on_silence == "retract":
        assert held["position_mm"][:, 2].min() > 15.0
