"""A dead accelerometer, through both services: nothing starts, and everyone is told why."""

import asyncio

from monitor_browser import monitored, open_browser, until

from mmt.evaluation.run_verdict import run_verdict
from mmt.scene import Scene
from mmt.session.files import write_session
from mmt.testing.simulation.offline import simulate_session

THROUGHOUT = "the accelerometer gave one value throughout"


async def test_a_dead_accelerometer_starts_no_model_and_is_named(tmp_path):
    frames, _ = simulate_session(Scene(), "plastic", 6.0)
    frames = frames.copy()
    frames["acceleration_m_s2"] = 9.81
    session = tmp_path / "dead.npz"
    write_session(session, frames)
    together = await monitored(
        tmp_path,
        simulated=None,
        hand=None,
        replay={"file": str(session), "speed": 2.0},
        texture={"order": 10},
    )
    async with open_browser() as browser:
        socket = await browser.look_on(together)
        following = asyncio.create_task(together.follow())
        while not (shown := await until(socket, "completion"))["faults"]:
            assert shown["start_s"] is None
    await following
    assert shown["faults"].startswith(THROUGHOUT)  # a busy machine may lose frames besides
    summary = await together.end()
    told = [sentence for sentence in together.said if THROUGHOUT in sentence]
    assert len(told) == 1
    assert told[0].startswith(f"not measured: {THROUGHOUT}")
    faults = summary.texture["faults"]
    assert faults["text"].startswith(THROUGHOUT)
    assert faults["constant_s"] > 0.5
    assert summary.texture["start_s"] is None
    found = run_verdict({"leader": summary.as_dict()})
    assert f"leader: not measured: {faults['text']}" in found.faults
